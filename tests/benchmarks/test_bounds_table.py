"""The table of bounds: what it says of plants with known answers, and that a bound that is too high does not pass."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks import bounds
from benchmarks.__main__ import main
from benchmarks.bounds import CLIPPED, DYNAMIC, GAIN, Line, chosen, clipped_law, lines, report
from benchmarks.plants import Case, scalar
from inc_casadi import Polytope, Spec
from inc_casadi.comparison.floors import Floor
from inc_casadi.errors import InvalidInputError


class Believed(Floor):
    """A lower bound that claims to hold whatever its numbers say."""

    def holds(self) -> bool:
        return True


@pytest.fixture(scope="module")
def line() -> Line:
    [found] = lines({"scalar": scalar(0.9)}, seconds=1.0)
    return found


def doctored(line: Line, key: str, value: float, kind: type[Floor] = Floor) -> Line:
    """The line with the bound of one class replaced by another figure."""
    floors = []
    for floor in line.found.floors:
        assert floor.bound is not None
        other = kind(floor.family, replace(floor.bound, value=value))
        floors.append(other if floor.family.key == key else floor)
    return replace(line, found=replace(line.found, floors=tuple(floors)))


def without(line: Line, *names: str) -> Line:
    return replace(line, found=replace(line.found, rows=tuple(row for row in line.found.rows if row.name not in names)))


def test_the_scalar_plant_has_the_paper_s_figures(line: Line):
    found = line.found
    assert found.cost_of(CLIPPED) == pytest.approx(1 / 3 + 0.9 / 36, rel=1e-7)
    assert found.cost_of(DYNAMIC) == pytest.approx(1 / 3 + 0.9 / 12, rel=1e-5)
    assert found.cost_of(GAIN) == pytest.approx(1 / (3 * (1 - 0.9 / 4)), rel=1e-7)
    any_, linear, static = (found.floor(key).value for key in ("any", "linear", "static"))  # type: ignore[union-attr]
    assert any_ == pytest.approx(found.cost_of(CLIPPED), rel=1e-5)
    assert linear == pytest.approx(found.cost_of(DYNAMIC), rel=1e-5)
    assert linear < static <= found.cost_of(GAIN)
    assert line.beaten == "linear" and line.inversions == []


def test_the_line_stands_under_its_headings(line: Line):
    said: list[str] = []
    assert report([line], said.append) == 0
    assert said[0].split()[:4] == ["plant", "n", "m", "p"] and len(said) == 4
    for heading, cell in (("any >=", "0.35833"), (CLIPPED, "0.35833"), (DYNAMIC, "0.40833"), (GAIN, "0.43010"),
                          ("clipped beats", "linear"), ("inverted", "none")):
        assert said[1][said[0].index(heading):].startswith(cell)


def test_lines_come_one_by_one_with_their_place_and_the_time_of_all_at_the_end(line: Line):
    said: list[str] = []
    two = (replace(line, seconds=spent, place=place) for spent, place in ((1.25, "1/2"), (2.5, "2/2")))
    report((said.append("worked out") or each for each in two), said.append)
    assert [words.split()[-1] for words in said[:5]] == ["of", "out", "1/2", "out", "2/2"]
    assert said[-1] == "2 plants, 3.8 s of processor time."


@pytest.mark.parametrize(("key", "value", "names"), [
    ("any", 0.36, ["any controller"]), ("linear", 0.41, ["linear controllers"]), ("static", 0.44, ["static linear gains"])])
def test_a_bound_above_a_certified_cost_of_its_class_is_an_inversion(line: Line, key: str, value: float, names: list[str]):
    wrong = doctored(line, key, value, Believed)
    said: list[str] = []
    assert report([line, wrong], said.append) == 1
    assert all(name in said[-1] for name in names) and said[-1].startswith("INVERTED: scalar: ")
    assert "YES" in said[2] and "none" in said[1]


def test_a_bound_below_every_cost_of_its_class_is_none(line: Line):
    assert doctored(line, "linear", 0.408, Believed).inversions == []
    assert doctored(line, "static", 0.42, Believed).inversions == []


def test_the_clipped_law_may_cost_less_than_a_bound_on_linear_controllers(line: Line):
    assert without(doctored(line, "linear", 0.43, Believed), DYNAMIC).inversions == []  # 0.358 is no linear controller's
    assert without(doctored(line, "linear", 0.44, Believed), DYNAMIC).inversions  # but a static gain is one


def test_a_bound_that_its_numbers_do_not_prove_is_reported_though_nothing_contradicts_it(line: Line):
    wrong = without(doctored(line, "linear", 0.42), DYNAMIC)
    assert wrong.found.inversions() == () and report([wrong], lambda words: None) == 1
    assert "do not prove it" in wrong.inversions[0]


def test_a_cost_outside_the_limits_is_marked_and_not_held_against_a_bound():
    case = chosen("two lags")["two lags"]
    [line] = lines({"two lags": case}, seconds=1.0)
    assert line.inversions == [] and "!8.15" in str(line)  # its best gain exceeds the limits after some steps
    assert line.found.cost_of(GAIN) == float("inf")
    assert line.found.cost_of(DYNAMIC) == pytest.approx(line.found.floor("linear").value, rel=1e-5)  # type: ignore[union-attr]


def test_what_cannot_be_had_is_a_dash(line: Line):
    assert "  -  " in str(without(line, GAIN, DYNAMIC)) and without(line, CLIPPED).beaten == ""


def test_the_clipped_law_of_output_feedback_clips_the_best_gain_without_limits():
    case = chosen("two lags, output")["two lags, output"]
    law = clipped_law(case)
    slope = float(law([0.1])[0]) / 0.1
    assert slope == pytest.approx(-1.6789, abs=1e-3)  # within limits the best gain is about half of it
    assert law([5.0]).tolist() == [-2.0] and law([-5.0]).tolist() == [2.0]


def test_clipping_needs_a_box():
    plant, spec, source = scalar()
    polytope = Spec(1.0, 0.0, 1.0, spec.initial, Polytope([[1.0], [-1.0]], [1, 1]))
    with pytest.raises(InvalidInputError, match="Box"):
        clipped_law(Case(plant, polytope, source))


def test_an_unknown_plant_is_refused_with_the_names_that_there_are(capsys):
    with pytest.raises(InvalidInputError, match="double integrator"):
        chosen("triple integrator")
    with pytest.raises(SystemExit):
        main(["bounds", "--plant", "triple integrator"])
    assert "no plant of the suite" in capsys.readouterr().err


def test_the_command_prints_one_plant_and_returns_its_status(monkeypatch, capsys, line: Line):
    asked = []
    monkeypatch.setattr(bounds, "lines", lambda cases: asked.append(list(cases)) or [doctored(line, "any", 0.4, Believed)])
    assert main(["bounds", "--plant", "scalar"]) == 1
    assert asked == [["scalar"]] and "INVERTED" in capsys.readouterr().out
    monkeypatch.setattr(bounds, "lines", lambda cases: [line])
    assert main(["bounds"]) == 0


@pytest.mark.parametrize("arguments", [["paper", "--plant", "scalar"], ["bounds", "--figures", "x"], ["bounds", "pieces"]])
def test_options_of_another_table_are_refused(arguments: list[str], capsys):
    with pytest.raises(SystemExit):
        main(arguments)
    assert "unrecognized arguments" in capsys.readouterr().err


@pytest.mark.slow
def test_no_plant_of_the_suite_shows_an_inversion():
    assert [(line.name, line.inversions) for line in lines(chosen(), seconds=2.0) if line.inversions] == []
