"""The sentences that follow from what a controller costs at most and what a class of controllers costs at least."""

from __future__ import annotations

from ..figures import at_least, at_most
from .families import Family


def beaten(family: Family, floor: float, subject: str, cost: float) -> str:
    """Return the clause of thm:general_superiority: every admissible member of the class costs more than this controller.

    >>> from .families import LINEAR
    >>> beaten(LINEAR, 2.11676311, "this controller", 1.36496190)
    'every admissible finite-order dynamic linear controller costs at least 2.116763; this controller costs at most 1.364962'
    """
    return f"{family.every} costs at least {at_least(floor)}; {subject} costs at most {at_most(cost)}"


def nearness(floor: float, subject: str, cost: float) -> str:
    """Return the clause on the best possible: a bound on every controller takes the place of beating all static laws.

    No controller with a static law u = mu(y) can be proved better than all of them (prop:no_arbitrary_sof); how far
    it is at most from the best of all controllers can be.

    >>> nearness(1.36479511, "this controller", 1.36496190)
    'no controller whatever costs less than 1.364795, so this controller is within 0.013 % of the best possible'
    """
    return (f"no controller whatever costs less than {at_least(floor)}, so {subject} is within "
            f"{percent(relative_gap(floor, cost))} of the best possible")


def short_of(family: Family, floor: float, subject: str, cost: float) -> str:
    """Return the clause that says by how much a separation is missed.

    >>> from .families import LINEAR
    >>> short_of(LINEAR, 2.0, "this controller", 2.5)
    'no separation from linear controllers is shown: this controller costs at most 2.5, their lower bound 2 is 0.5 too low'
    """
    missing = at_most(cost - floor, 4)
    return (f"no separation from {family.title} is shown: {subject} costs at most {at_most(cost)}, their lower bound "
            f"{at_least(floor)} is {missing} too low")


def relative_gap(floor: float, cost: float) -> float:
    """Return by what share the cost may exceed the best possible, floor > 0.

    >>> relative_gap(2.0, 2.5)
    0.25
    """
    return cost / floor - 1


def percent(share: float) -> str:
    """Return a share as per cent, rounded up, to a ten-thousandth of one per cent at the finest.

    >>> percent(0.00012187), percent(1e-13)
    ('0.013 %', '0.0001 %')
    """
    return f"{at_most(max(100 * share, 1e-4), 2)} %"


def sentence(clause: str) -> str:
    """Return a clause as a sentence.

    >>> sentence("it holds")
    'It holds.'
    """
    return clause[:1].upper() + clause[1:] + "."
