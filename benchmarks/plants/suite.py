"""The suite: every plant of this folder by name, for whoever measures on all of them."""

from __future__ import annotations

from collections.abc import Callable

from . import aircraft, compleib, compleib_larger, drives, oscillators, pendulums, tanks, textbook, vehicles
from .paper import Case, output_feedback, scalar, two_state

FAMILIES: tuple[Callable[[], dict[str, Case]], ...] = (
    lambda: {"scalar": scalar(0.95, 0.05), "two states": two_state(), "embedding, output": output_feedback(0.5, 0.95, 0.3)},
    textbook.cases, drives.cases, tanks.cases, pendulums.cases, vehicles.cases, aircraft.cases, compleib.cases,
    compleib_larger.cases, oscillators.cases,
)


def suite() -> dict[str, Case]:
    """Return all cases by name, in the order of the families; ", output" marks that less than the state is measured.

    A further family is one more function in FAMILIES that returns cases by name.

    Raises
    ------
    ValueError : two cases share a name

    >>> len(suite()) >= 29, suite()["two states"].source
    (True, 'eq:two_state_plant')
    """
    found: dict[str, Case] = {}
    for family in FAMILIES:
        more = family()
        twice = sorted(found.keys() & more.keys())
        if twice:
            raise ValueError(f"two plants of the suite are named {twice[0]!r}")
        found |= more
    return found
