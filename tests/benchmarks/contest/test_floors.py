"""The lower bounds that are written down: the best that holds, never one that its numbers do not prove."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.contest import floors as room
from benchmarks.contest.floors import floors, lower_bounds
from benchmarks.contest.settings import Settings
from benchmarks.plants import scalar
from inc_casadi.comparison import Comparison
from inc_casadi.errors import InfeasibleError

BRIEF = Settings(gains=0.3, linear=1.0, cells=300)
BETA = 0.9


@pytest.fixture(scope="module")
def found() -> Comparison:
    case = scalar(BETA)
    return Comparison(case.plant, case.spec, (), floors(case, BRIEF))


def test_the_bounds_are_those_of_the_theorems(found: Comparison):
    values = {one.family: one.value for one in lower_bounds(found)}
    assert values["any"] == pytest.approx(1 / 3 + BETA / 36, rel=1e-3)
    assert values["linear"] == pytest.approx(1 / 3 + BETA / 12, rel=1e-6)
    assert values["static"] == pytest.approx(1 / (3 * (1 - BETA / 4)), rel=1e-4)


def test_the_higher_of_two_bounds_is_written_down(found: Comparison):
    case = scalar(BETA)
    rough = floors(case, replace(BRIEF, cells=2))[0]
    assert rough.value < found.floors[0].value
    for both in ((rough, found.floors[0]), (found.floors[0], rough)):
        assert lower_bounds(replace(found, floors=both))[0].value == found.floors[0].value


def test_a_higher_bound_that_its_numbers_do_not_prove_is_not(found: Comparison):
    honest = found.floors[0]
    wrong = replace(honest, bound=replace(honest.bound, value=2 * honest.value))
    kept = lower_bounds(replace(found, floors=(wrong, honest)))[0]
    assert kept.holds and kept.value == honest.value
    alone = lower_bounds(replace(found, floors=(wrong,)))[0]
    assert not alone.holds and "not proved by its numbers" in alone.reason


def test_a_bound_that_cannot_be_had_leaves_the_others(monkeypatch):
    def fails(plant, spec, seconds):
        raise InfeasibleError("no linear controller is admissible")
    monkeypatch.setattr(room, "affine_moves", fails)
    any_, linear, static = floors(scalar(BETA), BRIEF)
    assert linear.bound is None and "no linear controller is admissible" in linear.reason
    assert any_.holds() and static.holds()


@pytest.mark.parametrize(("change", "again"), [
    ({}, []), ({"cut_short": True}, ["any"]), ({"value": 1.0}, ["any"])])  # 1.0 is more than its numbers prove
def test_a_class_is_worked_out_again_only_where_more_may_come_of_it(found: Comparison, change, again: list[str]):
    first, *others = found.floors
    known = (replace(first, bound=replace(first.bound, **change)), *others)
    assert [one.family.key for one in floors(scalar(BETA), BRIEF, known)] == again
