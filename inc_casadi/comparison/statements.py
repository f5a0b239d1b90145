"""What follows from a comparison, in sentences, each with what it rests on."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan

from ..bounds.unmeasured import UnmeasuredBound
from ..bounds.value_iteration import UnlimitedBound
from ..certificate import Proof
from .comparison import Comparison, label
from .families import ANY, FAMILIES, LINEAR, STATIC, Family
from .floors import Floor
from .row import CERTIFIED, VIOLATED, Row
from .sentences import beaten, nearness, sentence, short_of

ASSUMED = ("Assumed throughout: the model x+ = A x + B u, y = C x as given; limits kept at all times from every initial "
           "state; linear controllers are time-invariant, of any finite order, started from a fixed state.")
NOT_CLAIMED = ("That a controller beats every static nonlinear law is not claimed and cannot be true of all of them "
               "(prop:no_arbitrary_sof): its distance to the best possible is stated instead.")


@dataclass(frozen=True)
class Statement:
    """A sentence about a controller and a class. separates: whether it says that the class is beaten; grounds: in words."""

    name: str
    family: Family
    claim: str
    grounds: str
    separates: bool

    def __str__(self) -> str:
        return f"{self.claim} {self.grounds}".rstrip()


def statements(comparison: Comparison) -> tuple[Statement, ...]:
    """Return for each controller what is shown of it against each class, or why nothing is."""
    return tuple(statement for row in comparison.rows for statement in _of(comparison, row))


def clauses(comparison: Comparison, name: str, subject: str) -> list[str]:
    """Return what is shown of one controller as clauses: the largest class that it beats, and its distance to the best."""
    cost, shown = comparison.cost_of(name), []
    for family in FAMILIES.values():
        if comparison.separates(name, family):
            shown.append(beaten(family, _floor(comparison, family).value, subject, cost))
            break
    if not isnan(comparison.gap(name)):
        shown.append(nearness(_floor(comparison, ANY).value, subject, cost))
    return shown


def _of(comparison: Comparison, row: Row) -> list[Statement]:
    if not comparison.certifies(row.name):
        return [Statement(row.name, row.family, sentence(f"nothing is shown of {row.name}: {_uncertified(row)}"), "", False)]
    found = []
    for family in {floor.family: None for floor in comparison.floors if floor.bound is not None}:
        floor = comparison.floor(family)
        clause = "" if floor is None else _clause(comparison, row, family, floor)
        if floor is not None and clause:
            claim = sentence(f"{clause}; {_known(comparison, row, floor)}")
            separates = comparison.separates(row.name, family)
            found.append(Statement(row.name, family, claim, _rests_on(comparison, row, floor), separates))
    return sorted(found, key=lambda statement: not statement.separates)


def _clause(comparison: Comparison, row: Row, family: Family, floor: Floor) -> str:
    """What cost and bound give; a class that a larger class's bound disposes of already is left to that class."""
    cost = comparison.cost_of(row.name)
    if comparison.separates(row.name, family):
        return beaten(family, floor.value, row.name, cost) if floor.family is family else ""
    if family is ANY:
        return nearness(floor.value, row.name, cost) if floor.value > 0 else ""
    return "" if family.contains(row.family) else short_of(family, floor.value, row.name, cost)


def _floor(comparison: Comparison, family: Family) -> Floor:
    floor = comparison.floor(family)
    assert floor is not None
    return floor


def _uncertified(row: Row) -> str:
    """Say what stands in the way of a certificate, all that was tried."""
    known = [row.limits.reason] if row.limits.verdict == VIOLATED else []
    if row.limits.verdict != CERTIFIED and row.cost.evidence is not None and not known:
        known = [f"that it keeps the limits is not certified, only {row.limits.verdict}"]
    known += [row.converges.reason] if row.converges.verdict == VIOLATED else []
    return "; ".join(known or row.notes) or "it was only simulated"


def _known(comparison: Comparison, row: Row, floor: Floor) -> str:
    """Say by what means the two figures are known."""
    cost, bound = comparison.proofs.get(row.name), comparison.proofs.get(label(floor))
    if cost and bound:
        return "both are proved"
    if cost:
        return "the cost is proved, the bound holds in floating point less an allowance for rounding"
    if bound:
        return "the bound is proved, the cost holds in floating point"
    return "both hold in floating point"


def _rests_on(comparison: Comparison, row: Row, floor: Floor) -> str:
    return f"The cost rests on: {cost_grounds(comparison, row)}. The bound rests on: {bound_grounds(comparison, floor)}."


def cost_grounds(comparison: Comparison, row: Row) -> str:
    """Return what the certified cost of a controller rests on."""
    return f"{row.cost.words}; the limits: {row.limits.reason}{_means(comparison.proofs.get(row.name))}"


def bound_grounds(comparison: Comparison, floor: Floor) -> str:
    """Return what a lower bound rests on."""
    return f"{dual_words(floor)}{_means(comparison.proofs.get(label(floor)))}"


def _means(proof: Proof | None) -> str:
    if proof is None:
        return ""
    return f" ({proof.method})" if proof else f" (not settled rigorously: {proof.reason})"


def dual_words(floor: Floor) -> str:
    """Return which dual a lower bound rests on.

    >>> from .families import STATIC
    >>> dual_words(Floor(STATIC, None))
    'branch and bound over all gains'
    """
    if isinstance(floor.bound, UnlimitedBound):
        return f"{floor.bound.steps} steps of value iteration without limits"
    if isinstance(floor.bound, UnmeasuredBound):
        return f"{floor.bound.steps} steps of value iteration without limits and what the measurements leave unknown"
    return {ANY: "tangents of the cost at trial input sequences, cell by cell",
            LINEAR: "the Lagrangian of moves affine in the initial state",
            STATIC: "branch and bound over all gains"}[floor.family]
