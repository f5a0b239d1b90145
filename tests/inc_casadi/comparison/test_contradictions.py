"""Contradictions between costs and bounds are caught, and what does not hold is not built on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from benchmarks.plants.paper import scalar
from inc_casadi import INC, compare
from inc_casadi.bounds import Bound
from inc_casadi.certificate import Proof
from inc_casadi.comparison import Comparison
from inc_casadi.comparison.families import ANY, LINEAR, STATIC
from inc_casadi.comparison.floors import Floor
from inc_casadi.comparison.row import CERTIFIED, EXACT, VIOLATED, Cost, Finding, Row
from inc_casadi.errors import INCError, InvalidInputError


@dataclass(frozen=True, eq=False)
class Liar(Bound):
    """A bound that claims to hold whatever it says."""

    statement = "Trust me."  # type: ignore[assignment]

    def dual(self) -> tuple[float, float]:
        return self.value, 0.0


@dataclass(frozen=True, eq=False)
class Trusted:
    """Evidence whose verdict is chosen."""

    held: bool = True

    def holds(self) -> bool:
        return self.held

    def prove(self) -> Proof:
        return Proof(self.held, "by hand", 0.0, "" if self.held else "it was dropped")


def row(name: str, cost: float, family=ANY, verdict=CERTIFIED, held: bool = True) -> Row:
    return Row(name, None, "test", family, Finding(verdict, "so"), cost=Cost(cost, EXACT, 0.0, Trusted(held), "a hand"))


def floor(family, value: float) -> Floor:
    return Floor(family, Liar(CASE.plant, CASE.spec, value, 0.0))


CASE = scalar(0.9)


def made(rows, floors) -> Comparison:
    return Comparison(CASE.plant, CASE.spec, tuple(rows), tuple(floors))


@pytest.fixture(scope="module")
def honest() -> Comparison:
    laws = {"sat": INC.saturated([[-1.5]], 1.0), "gain": [[-1.0]]}
    return compare(CASE.plant, CASE.spec, laws, bounds=["any", "linear"], cells=200)


def test_a_raised_bound_is_caught_and_not_built_on(honest: Comparison):
    raised = [replace(one, bound=replace(one.bound, value=one.value + 0.1)) for one in honest.floors]
    doctored = replace(honest, floors=tuple(raised))
    caught = {(one.name, one.family.key) for one in doctored.inversions()}
    assert caught == {("sat", "any"), ("gain", "any"), ("gain", "linear")}
    with pytest.raises(INCError, match="sat is certified to cost at most 0.3583334"):
        doctored.require_consistent()
    assert "INCONSISTENT" in str(doctored) and "NOT CONFIRMED" in str(doctored)
    assert not doctored.separates("sat", "linear") and doctored.floor("any") is None
    assert honest.require_consistent() is honest and honest.separates("sat", "linear")


def test_a_bound_that_lies_about_itself_is_caught_by_the_members_of_its_class():
    lying = made([row("gain", 2.0, STATIC), row("net", 1.5)], [floor(LINEAR, 2.5), floor(ANY, 1.0)])
    [caught] = lying.inversions()
    assert (caught.name, caught.family, caught.cost, caught.bound) == ("gain", LINEAR, 2.0, 2.5)
    with pytest.raises(INCError, match="contradicts itself: gain"):
        lying.require_consistent()
    assert not lying.separates("gain", "linear")  # no controller is separated from its own class


def test_a_bound_that_does_not_hold_is_told_though_nothing_contradicts_it(honest: Comparison):
    [linear] = [one for one in honest.floors if one.family is LINEAR]
    raised = replace(linear, bound=replace(linear.bound, value=linear.value + 1e-3))
    shaky = replace(honest, floors=(raised,))
    assert shaky.inversions() == ()
    with pytest.raises(INCError, match="do not prove 0.40"):
        shaky.require_consistent()


def test_a_row_is_proved_when_all_that_it_rests_on_is():
    good, bad = row("net", 1.0), row("net", 1.0, held=False)
    assert good.prove() and not bad.prove() and bad.prove().reason == "it was dropped"
    assert not replace(good, grounds=(Trusted(False),)).prove() and replace(good, grounds=(Trusted(),)).prove()
    assert not row("net", 1.0, verdict=VIOLATED).prove()


def test_a_bound_that_a_member_attains_up_to_rounding_is_no_contradiction():
    assert made([row("best", 1.0)], [floor(ANY, 1.0 + 5e-10)]).inversions() == ()
    assert len(made([row("best", 1.0)], [floor(ANY, 1.0 + 2e-9)]).inversions()) == 1


def test_a_bound_on_a_smaller_class_says_nothing_of_a_larger_one():
    shown = made([row("net", 1.0, ANY), row("lag", 1.0, LINEAR)], [floor(STATIC, 3.0)])
    assert shown.inversions() == () and shown.floor("linear") is None and shown.floor("any") is None
    assert shown.separates("net", "static") and shown.separates("lag", "static") and not shown.separates("net", "linear")


def test_the_bound_of_a_larger_class_serves_the_smaller():
    shown = made([row("net", 1.0)], [floor(STATIC, 2.0), floor(LINEAR, 3.0), floor(ANY, 0.5)])
    assert shown.floor("static").value == shown.floor("linear").value == 3.0 and shown.gap("net") == pytest.approx(1.0)
    assert [one.family for one in shown.statements] == [LINEAR, ANY]  # what the larger class has is not said twice


@pytest.mark.parametrize("other", [row("x", 1.0, verdict=VIOLATED), row("x", 1.0, held=False),
                                   Row("x", None, "test", cost=Cost(1.0, EXACT, 0.0, Trusted()))])
def test_what_is_not_certified_neither_separates_nor_contradicts(other: Row):
    shown = made([other], [floor(LINEAR, 3.0), floor(ANY, 2.0)])
    assert not shown.certifies("x") and shown.inversions() == () and not shown.separates("x", "linear")
    [one] = shown.statements
    assert one.claim.startswith("Nothing is shown of x") and not one.separates


def test_equal_figures_do_not_separate():
    assert not made([row("net", 2.0)], [floor(LINEAR, 2.0)]).separates("net", "linear")


def test_proofs_speak_of_each_side():
    shown = made([row("net", 1.0)], [floor(LINEAR, 2.0)]).proved()
    assert shown.proofs["net"] and not shown.proofs["lower bound, linear controllers"]
    assert "the cost is proved, the bound holds in floating point" in shown.statements[0].claim
    yes = Proof(True, "by hand", 0.0)
    both = replace(shown, proofs={"net": yes, "lower bound, linear controllers": yes})
    assert both.statements[0].claim.endswith("both are proved.")
    neither = replace(shown, proofs={})
    assert neither.statements[0].claim.endswith("both hold in floating point.")


def test_names_that_are_not_there_are_refused(honest: Comparison):
    with pytest.raises(InvalidInputError, match="'sat', 'gain'"):
        honest.gap("cat")
    with pytest.raises(InvalidInputError, match="'any', 'linear', 'static'"):
        honest.separates("sat", "lin")
