"""Pictures of the search: lines are the histories, what was refused is seen, only what is certified is called so."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from inc_casadi import INC, Box, DiscountedCost, Plant
from inc_casadi.errors import InvalidInputError
from inc_casadi.plotting import plot_alternation, plot_training
from inc_casadi.plotting.training_figure import phases_of
from synthesis.alternation import Alternation, alternate


def row(phase: str, iteration: int, cost: float, seconds: float) -> dict[str, Any]:
    return {"phase": phase, "iteration": iteration, "cost": cost, "seconds": seconds}


TRAINED = SimpleNamespace(cost=1.25, start_cost=4.0, history=(
    row("short", 0, np.inf, 0.5), row("short", 1, 3.0, 1.0), row("coarse", 0, 2.5, 1.5), row("coarse", 1, 1.5, 2.0),
    row("coarse", 2, 1.4, 2.5), row("tightened", 0, 1.3, 3.0), row("tightened", 0, 1.2, 3.5), row("tightened", 1, 1.1, 4.5)))


def legend(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def widths(axes: Any) -> list[float]:
    return [part.get_width() for part in axes.patches if isinstance(part, Rectangle)]


def test_each_phase_is_a_line_of_its_own_that_goes_on_where_the_last_one_ended():
    left, _ = plot_training(TRAINED).axes
    lines = [line for line in left.lines if len(line.get_xdata()) != 2 or line.get_marker() != "None"][:4]
    assert [list(line.get_xdata()) for line in lines] == [[0, 1], [1, 2, 3], [3], [3, 4]]
    assert np.isnan(lines[0].get_ydata()[0]) and list(lines[1].get_ydata()) == [2.5, 1.5, 1.4]
    assert [words for words in legend(left) if "phase" in words] == [
        "phase 'short'", "phase 'coarse'", "phase 'tightened'", "phase 'tightened'"]


def test_start_and_outcome_stand_across_and_are_not_called_certified():
    left, _ = plot_training(TRAINED).axes
    levels = {line.get_linestyle(): line.get_ydata()[0] for line in left.lines if line.get_color() == "black"}
    assert levels == {":": 4.0, "--": 1.25}
    assert "certified" not in " ".join([left.get_title(), *legend(left)]) and "not a proof" in left.get_title()


def test_bars_are_the_seconds_of_each_phase():
    _, right = plot_training(TRAINED).axes
    assert widths(right) == pytest.approx([1.0, 1.5, 0.5, 1.5])
    assert [text.get_text() for text in right.get_yticklabels()] == ["short", "coarse", "tightened", "tightened"]
    assert sum(seconds for *_, seconds in phases_of(TRAINED.history)) == pytest.approx(4.5)


def test_costs_of_different_size_take_a_logarithmic_axis():
    wide = SimpleNamespace(cost=1.0, start_cost=np.inf, history=[row("a", 0, 100.0, 0.1), row("a", 1, 1.0, 0.2)])
    left, _ = plot_training(wide).axes
    assert left.get_yscale() == "log" and plot_training(TRAINED).axes[0].get_yscale() == "linear"
    assert [words for words in legend(left)] == ["phase 'a'", "outcome, on unseen nodes: 1"]


def attempt(name: str, cost: float, mean: float, training: tuple = ()) -> Any:
    run = None if np.isnan(mean) else SimpleNamespace(mean=mean, standard_error=0.05)
    return SimpleNamespace(name=name, certified=bool(np.isfinite(cost)), verdict=SimpleNamespace(cost=cost), estimate=run,
                           training=training)


RESULT = SimpleNamespace(seconds={"bounds": 0.5, "search": 2.0, "in all": 2.5}, history=(
    attempt("clipped", 2.0, 1.9), attempt("trained", 1.23456789, 1.2, ((0.1, 2.0), (0.3, 1.3))),
    attempt("wild", np.inf, 5.0), attempt("broken", np.inf, np.nan)))


def test_attempts_show_certified_and_simulated_costs_each_with_its_mark():
    left, middle, right = plot_training(RESULT).axes
    full = {float(line.get_ydata()[0]): float(line.get_xdata()[0]) for line in middle.lines if line.get_marker() == "D"}
    hollow = {float(line.get_ydata()[0]): float(line.get_xdata()[0]) for line in middle.lines if line.get_marker() == "o"}
    assert full == {0.0: 2.0, 1.0: 1.23456789} and hollow == {0.0: 1.9, 1.0: 1.2, 2.0: 5.0}
    assert [text.get_text() for text in middle.get_yticklabels()] == [
        "clipped\nat most 2", "trained\nat most 1.234568", "wild\nnothing is certified", "broken\nnothing is certified"]
    assert list(left.lines[0].get_xdata()) == [0.1, 0.3] and list(left.lines[0].get_ydata()) == [2.0, 1.3]
    assert widths(right) == [0.5, 2.0]  # the sum is no phase


def test_without_training_and_without_figures_the_panels_say_so():
    left, middle, _ = plot_training(SimpleNamespace(seconds={}, history=(attempt("a", np.inf, np.nan),))).axes
    assert [text.get_text() for text in left.texts] == ["no attempt was trained"] and middle.get_legend() is None


def test_what_is_no_training_is_refused():
    with pytest.raises(InvalidInputError, match="history of this SimpleNamespace is empty"):
        plot_training(SimpleNamespace(history=()))
    with pytest.raises(InvalidInputError, match="see plot_alternation"):
        plot_training(SimpleNamespace(history=({"round": 0, "bound": 1.0},)))
    with pytest.raises(InvalidInputError, match="history holds int"):
        plot_training(SimpleNamespace(history=(1,)))
    with pytest.raises(InvalidInputError, match="history of this float"):
        plot_training(1.0)


@pytest.fixture(scope="module")
def descent() -> Alternation:
    plant = Plant([[0.9, 0.3], [-0.2, 0.8]], [[0.0], [1.0]], [[1.0, 0.5]])
    law = INC([[0.1, -0.2], [0.3, 0.0]], [[1.0], [-1.0]], [[0.1, 0.2]], [[0.0]])
    return alternate(plant, law, DiscountedCost(np.eye(2), 0.1, 0.95, Box([-1, -1], [1, 1])), max_rounds=6)


@pytest.fixture(scope="module")
def shown(descent: Alternation) -> Figure:
    return plot_alternation(descent)


def trial(k: int, rung: str, bound: float, tried: float, accepted: bool, phase: str = "cost") -> dict[str, Any]:
    return {"round": k, "phase": phase, "rung": rung, "bound": bound, "trial": tried, "accepted": accepted, "radius": 0.5**k}


STUB = SimpleNamespace(start_bound=9.0, history=[
    trial(0, "sector", 5.0, 5.0, True), trial(1, "sector", 5.0, 6.0, False), trial(2, "sector", 5.0, np.inf, False),
    trial(3, "relu", 4.0, 4.0, True)])


def marks(axes: Any, marker: str) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for line in axes.lines if line.get_marker() == marker
            for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)]


def test_the_staircase_is_the_bound_after_each_round(descent: Alternation, shown: Figure):
    stairs = shown.axes[0].lines[0]
    assert list(stairs.get_ydata()) == [descent.start_bound, *(one["bound"] for one in descent.history)]
    assert list(stairs.get_xdata()) == list(range(-1, len(descent.history))) and stairs.get_drawstyle() == "steps-post"


def test_the_title_states_the_certified_cost_and_only_a_certificate_that_holds(descent: Alternation, shown: Figure):
    title = shown.axes[0].get_title()
    assert title.startswith("Alternation: certified cost at most ")
    assert float(title.split()[-1]) >= descent.certificate.bound
    assert plot_alternation(STUB).axes[0].get_title() == "Alternation"
    refused = SimpleNamespace(holds=lambda: False, bound=1.0)
    figure = plot_alternation(SimpleNamespace(**vars(STUB), certificate=refused))
    assert figure.axes[0].get_title() == "Alternation: nothing is certified"


def test_accepted_and_refused_trials_have_marks_of_their_own():
    above, below = plot_alternation(STUB).axes
    assert marks(above, "o") == [(0.0, 5.0), (3.0, 4.0)] and marks(above, "x") == [(1.0, 6.0)]
    assert [x for x, _ in marks(above, "^")] == [2.0]  # it has no bound: it stands at the upper edge
    assert marks(below, "x") == [(1.0, 0.5), (2.0, 0.25)] and below.get_yscale() == "log"
    assert legend(above) == ["certified bound after the round", "start: at most 9", "accepted",
                             "refused, the step is damped", "refused: no certificate"]


def test_rungs_are_named_where_they_begin():
    above, _ = plot_alternation(STUB).axes
    assert [(text.get_text(), text.xy[0]) for text in above.texts] == [("sector", -0.5), ("relu", 2.5)]


def test_feasibility_is_told_from_the_cost_that_is_asked_for():
    rows = [trial(0, "sector", 50.0, 50.0, True, "feasibility"), trial(1, "sector", 3.0, 3.0, True)]
    above, _ = plot_alternation(SimpleNamespace(start_bound=np.inf, history=rows)).axes
    stairs, other = above.lines[:2]
    assert list(stairs.get_ydata()) == [3.0] and list(other.get_ydata()) == [50.0] and other.get_linestyle() == ":"
    assert not any("start" in words for words in legend(above))


def test_what_is_no_alternation_is_refused_and_it_is_written(descent: Alternation, tmp_path: Path):
    with pytest.raises(InvalidInputError, match="has no round"):
        plot_alternation(SimpleNamespace(history=[], start_bound=1.0))
    with pytest.raises(InvalidInputError, match="lack accepted, bound"):
        plot_alternation(TRAINED)
    plot_alternation(descent, tmp_path / "alternation.png")
    plot_training(TRAINED, tmp_path / "training.svg")
    assert (tmp_path / "alternation.png").stat().st_size > 10_000
    assert b"<svg" in (tmp_path / "training.svg").read_bytes()[:999]
