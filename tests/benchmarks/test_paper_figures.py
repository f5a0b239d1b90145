"""The paper's figures agree with the computed ones, and a figure that does not agree is noticed."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from benchmarks import paper
from benchmarks.paper import implicit, separation, two_states
from benchmarks.paper.row import Row


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return paper.all_rows()


def test_every_figure_agrees_with_what_is_printed(rows: list[Row]):
    assert [row.name for row in rows if not row.agrees] == []


def test_no_figure_is_listed_twice_and_none_is_left_out(rows: list[Row]):
    assert max(Counter(row.name for row in rows).values()) == 1
    sources = Counter(row.source for row in rows)
    wanted = {"sec:numerics_implicit": 15, "eq:implicit_example_certificate": 3, "tab:implicit_reproducibility": 5,
              "eq:nn_cost_state": 3, "eq:lsof_optimal_cost": 3, "eq:r_threshold": 3, "cor:genuine_of": 2,
              "sec:numerics, two states": 10, "fig:scalar_separation": 6}
    for source, least in wanted.items():
        assert sources[source] >= least, source


@pytest.mark.parametrize(("row", "agrees"), [
    (Row("", "1.3006", 1.30055, ""), True),
    (Row("", "1.3006", 1.3007, ""), False),
    (Row("", "-2.23e-5", -2.2278e-5, ""), True),
    (Row("", "-2.23e-5", -2.22e-5, ""), False),
    (Row("", "1.3579 +- 0.0071", 1.36496190, ""), True),
    (Row("", "1.3579 +- 0.0071", 1.3651, ""), False),
    (Row("", "25", 24.0, "", "<="), True),
    (Row("", "25", 26.0, "", "<="), False),
    (Row("", "1.3639", 1.3643, "", ">="), True),
    (Row("", "1.3639", 1.3637, "", ">="), False),
])
def test_agreement_is_to_the_printed_rounding(row: Row, agrees: bool):
    assert row.agrees is agrees


def test_a_wrong_figure_is_reported():
    text = paper.report([Row("right", "1.0", 1.0, "here"), Row("wrong", "1.0", 1.1, "there")])
    assert "NO" in text and text.endswith("1 of 2 figures agree with what is printed.")


def test_the_two_relu_law_is_the_saturation():
    law = separation.two_relu_law()
    assert law([[-2.0, -0.5, 0.0, 0.4, 2.0]])[0] == pytest.approx([1.0, 0.75, 0.0, -0.6, -1.0])


def test_picard_counts_depend_on_the_tolerance():
    law = implicit.implicit_controller()
    assert implicit.picard_iterations(law, 1e-3) < implicit.picard_iterations(law) <= 25


def test_the_largest_input_is_counted_over_time():
    assert two_states.largest_input(np.zeros((1, 2))) == (0.0, 0)
    largest, step = two_states.largest_input(np.array([[0.1, 0.0]]))  # a destabilizing gain needs more input later on
    assert largest > 0.08 and step > 0
