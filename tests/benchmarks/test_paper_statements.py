"""What sec:numerics says in words or finds by search, as rows: right where computed, and noticed where wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from benchmarks.paper import implicit, scalar_figure, two_states
from benchmarks.paper.direct_search import Searched, direct_search, largest_eigenvalue
from benchmarks.paper.row import Row
from benchmarks.plants import scalar
from inc_casadi import INC, certify
from inc_casadi.plotting.separation_figure import STARTS

SLOW_LAW = INC.saturated([[-1.4]], [1.0])  # u = -sat(1.4 x): x_1 = 0.1 x_0 near the origin, which is never reached
EARLY_LAW = INC.saturated([[-1.5]], [0.8])  # x_1 = 0.7 from x_0 = 1, where it is beyond its corner again
LINEAR = INC.linear([[-1.5]])  # the gain near the origin, without limits


def disagrees(rows: Sequence[Row], name: str) -> bool:
    """Whether the one row of that name, or else the one whose name begins so, disagrees."""
    row, = [row for row in rows if row.name == name] or [row for row in rows if row.name.startswith(name)]
    return not row.agrees


@pytest.fixture(scope="module")
def wrong_two_states() -> list[Row]:
    """The rows of the two-state example when 190000 starts are sampled and the largest input is said to come at k = 1."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(two_states, "SAMPLES", 190_000)
        patch.setattr(two_states, "largest_input", lambda F: (1.0, 1))
        return two_states.rows()


def test_the_saturated_law_is_at_rest_after_two_steps_from_the_starts_that_are_drawn():
    assert scalar_figure.steps_to_the_origin(scalar_figure.two_relu_law(), np.array(STARTS)) == 2


@pytest.mark.parametrize(("law", "start", "steps"), [(LINEAR, 1.0, 1), (LINEAR, 0.0, 0), (SLOW_LAW, 0.5, 12)])
def test_steps_to_the_origin_by_hand(law: INC, start: float, steps: int):
    assert scalar_figure.steps_to_the_origin(law, np.array([start])) == steps  # 0.5 * 0.1^12 is below 1e-12


def test_the_first_slope_is_the_best_of_a_grid():
    kappa = np.linspace(-1.0, 1.0, 2001)
    best = [kappa[np.argmin(1 / 3 + beta * (1.5 + kappa) ** 2 / 3)] for beta in scalar_figure.SHOWN]
    assert scalar_figure.first_slopes() == pytest.approx(best, abs=1e-6)


@pytest.mark.parametrize(("name", "wrong", "part"), [
    ("two_relu_law", lambda: SLOW_LAW, "two-ReLU law, slope"),
    ("two_relu_law", lambda: SLOW_LAW, "two-ReLU law, steps"),
    ("two_relu_law", lambda: EARLY_LAW, "two-ReLU law, |u|"),
    ("two_relu_law", lambda: EARLY_LAW, "two-ReLU law, steps"),
    ("scalar", lambda beta=1.0, r=0.0: scalar(beta, r + 2.0), "best linear first move"),
    ("first_slopes", lambda: np.array([-1.0, -0.9999]), "best linear first move"),
    ("gaps", lambda: scalar_figure.SHOWN / 18.01, "least gap"),
    ("best_static_gain", lambda plant, spec: type("Gain", (), {"F": [[-1.5]]}), "best static gain, steps"),
])
def test_a_wrong_statement_on_the_scalar_figure_is_noticed(monkeypatch: pytest.MonkeyPatch, name: str,
                                                           wrong: Callable[..., Any], part: str):
    monkeypatch.setattr(scalar_figure, name, wrong)
    assert disagrees(scalar_figure.rows(), part)


@pytest.mark.parametrize("W", [0.0, 1.0])
def test_the_direct_search_ends_where_the_lmi_solver_does(W: float):
    printed = implicit.printed_certificate(W)
    solved = certify(printed.plant, printed.inc, printed.claim, multiplier="sector").require()
    assert direct_search(printed.inequalities, 1.0, 3.0).P == pytest.approx(3 * solved.bound, abs=1e-6)


def test_the_lmi_can_be_solved_above_the_searched_P_and_on_no_grid_point_below():
    inequalities = implicit.printed_certificate().inequalities
    P, lam = direct_search(inequalities, 1.0, 3.0)
    assert largest_eigenvalue(inequalities, Searched(P + 1e-6, lam)) < 0
    below = [largest_eigenvalue(inequalities, Searched(P - 1e-6, one)) for one in np.linspace(0.5, 1.5, 1001)]
    assert min(below) > 0


def test_the_searched_point_is_on_the_boundary():
    inequalities = implicit.printed_certificate().inequalities
    assert abs(largest_eigenvalue(inequalities, direct_search(inequalities, 1.0, 3.0))) < 1e-10


def test_a_search_that_brackets_nothing_is_refused():
    with pytest.raises(ValueError, match="different signs"):
        direct_search(implicit.printed_certificate().inequalities, 1.4, 3.0)


@pytest.mark.parametrize(("wrong", "part"), [
    (Searched(1.3007, 0.77486), "P, direct search with Lambda = lambda I"),
    (Searched(1.30056, 0.7750), "lambda, direct search"),
    (Searched(1.30056, 0.7750), "lambda_max of the LMI at the searched"),
    (Searched(1.3571, 0.77486), "P, direct search with Lambda = lambda I, W = 0"),
])
def test_a_wrong_search_is_noticed(monkeypatch: pytest.MonkeyPatch, wrong: Searched, part: str):
    monkeypatch.setattr(implicit, "direct_search", lambda *_: wrong)
    assert disagrees(implicit.rows(), part)


def test_a_controller_other_than_the_printed_one_has_another_search_result(monkeypatch: pytest.MonkeyPatch):
    printed = implicit.printed_certificate
    monkeypatch.setattr(implicit, "printed_certificate", lambda W=1.0: printed(0.99 * W + 0.01))
    assert disagrees(implicit.rows(), "P, direct search with Lambda = lambda I, W = 0")


def test_the_largest_input_of_a_destabilizing_gain_comes_last():
    largest, step = two_states.largest_input(np.array([[0.1, 0.0]]), 30)
    assert step == 30 and largest > 0.08


@pytest.mark.parametrize("part", ["step k at which it is attained", "two standard errors of the cost sampled here"])
def test_a_wrong_statement_on_the_two_state_example_is_noticed(wrong_two_states: list[Row], part: str):
    assert disagrees(wrong_two_states, part)


def test_what_is_not_wrong_there_still_agrees(wrong_two_states: list[Row]):
    assert sum(not row.agrees for row in wrong_two_states) == 2
