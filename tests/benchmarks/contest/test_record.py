"""A record comes back from JSON as it was, and what is not a whole one is refused."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from benchmarks.contest.record import PlantRecord, from_plain, to_plain
from benchmarks.contest.sample import NOWHERE, entry, record
from benchmarks.contest.settings import QUICK, Settings
from inc_casadi.errors import FormatError, InvalidInputError


@pytest.fixture
def full() -> PlantRecord:
    made = record(1.0 / 3.0, {"LQG": 0.1 + 0.2}, settings=replace(QUICK, only=("LQG",)), inversions=("a", "b"))
    more = entry("MPC", None, beats=("linear", "static"), proved=True, reason='say "no"')
    return replace(made, entries=(*made.entries, more))


def test_a_record_comes_back_from_json_equal_in_every_bit(full: PlantRecord):
    assert from_plain(json.loads(json.dumps(to_plain(full)))) == full


@pytest.mark.parametrize("spoil", [
    lambda plain: plain.pop("entries"), lambda plain: plain.update(entries=None), lambda plain: plain.update(more=1),
    lambda plain: plain["entries"][0].pop("cost"), lambda plain: plain["entries"][0].update(colour="red"),
    lambda plain: plain["bounds"].append({}), lambda plain: plain.update(settings=[]), lambda plain: plain.update(version=1),
])
def test_what_is_no_whole_record_is_refused(full: PlantRecord, spoil):
    plain = json.loads(json.dumps(to_plain(full)))
    spoil(plain)
    with pytest.raises(FormatError, match="record of the suite"):
        from_plain(plain)


def test_a_bound_that_its_numbers_do_not_prove_is_none(full: PlantRecord):
    assert full.bound("any") == 1.0 and full.bound("linear") is None
    assert replace(full, bounds=(replace(full.bounds[0], holds=False),)).bound("any") is None


@pytest.mark.parametrize(("change", "same"), [
    ({}, True), ({"date": "later"}, True), ({"cores": 64}, True), ({"commit": "other"}, True), ({"source": "t"}, False),
    ({"versions": {"python": "3.11.0", "numpy": "2.0.1"}}, False)])
def test_the_same_code_is_the_same_versions_and_source(change, same: bool):
    assert NOWHERE.same_code(replace(NOWHERE, **change)) is same


@pytest.mark.parametrize("change", [
    {"search": 0.0}, {"seed": -1}, {"hidden": 1.5}, {"region": -1.0}, {"limit": float("nan")}])
def test_budgets_that_are_none_are_refused(change):
    with pytest.raises(InvalidInputError, match=next(iter(change))):
        Settings(**change)
