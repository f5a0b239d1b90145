"""The chart of a comparison: marks stand where the costs are, shades where members of the class cannot be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from benchmarks.plants.paper import scalar
from inc_casadi import INC, compare
from inc_casadi.comparison import Comparison
from inc_casadi.plotting import plot_comparison

CASE = scalar(0.9)


@pytest.fixture(scope="module")
def shown() -> Comparison:
    laws = {"gain": [[-1.0]], "sat": INC.saturated([[-1.5]], 1.0), "wild": [[-1.4]], "f": lambda y: np.clip(-y, -1, 1)}
    return compare(CASE.plant, CASE.spec, laws, bounds=["any", "linear"], cells=100, samples=300)


def test_marks_lines_and_shades_are_where_the_figures_are(shown: Comparison, tmp_path: Path):
    figure = shown.plot(tmp_path / "chart.png")
    [axes] = figure.axes
    assert (tmp_path / "chart.png").read_bytes().startswith(b"\x89PNG")
    labels = [text.get_text().split("\n")[0] for text in axes.get_yticklabels()]
    assert labels == ["sat (neural, 1 unit)", "f (callable law)", "gain (static linear gain)", "wild (static linear gain)"]
    marks = {(line.get_marker(), round(float(line.get_ydata()[0]))): line.get_xdata()[0] for line in axes.lines
             if line.get_marker() in "Dox"}
    assert marks[("D", 0)] == shown.cost_of("sat") and marks[("D", 2)] == shown.cost_of("gain")
    assert ("x", 3) in marks and ("o", 1) in marks
    ends = [round(bar.get_x() + bar.get_width(), 9) for bar in axes.patches if isinstance(bar, Rectangle)]
    any_, linear = (round(shown.floor(key).value, 9) for key in ("any", "linear"))
    assert ends == [any_, any_, linear, linear]
    dashed = {round(float(line.get_xdata()[0]), 9) for line in axes.lines if line.get_linestyle() == "--"}
    assert dashed == {any_, linear}


def test_the_legend_names_what_is_drawn(shown: Comparison):
    [legend] = plot_comparison(shown).legends
    words = " ".join(text.get_text() for text in legend.get_texts())
    for part in ("linear controllers: at least 0.4", "any controller", "simulated", "breaks the input limits", "certified"):
        assert part in words
    assert "upper bound" not in words


def test_nothing_known_is_said():
    text = Comparison(CASE.plant, CASE.spec, (), ()).plot().axes[0].texts[0].get_text()
    assert text == "neither a cost nor a bound is known"
