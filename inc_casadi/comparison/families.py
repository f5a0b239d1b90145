"""The classes of controllers that lower bounds speak of, each contained in the next."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InvalidInputError


@dataclass(frozen=True)
class Family:
    """A class of admissible controllers.

    Static linear gains are linear controllers of order zero, and linear controllers are controllers, so a lower bound on
    a class is one on every class within it.

    Parameters
    ----------
    key : how it is asked for: "static", "linear" or "any"
    title : the class in a table
    every : its members as the subject of a sentence
    rank : a class contains those of a lower rank and itself
    """

    key: str
    title: str
    every: str
    rank: int

    def contains(self, other: Family) -> bool:
        """Return whether every member of the other class is a member of this one.

        >>> ANY.contains(STATIC), STATIC.contains(LINEAR)
        (True, False)
        """
        return other.rank <= self.rank


STATIC = Family("static", "static linear gains", "every admissible static linear gain u = F y", 0)
LINEAR = Family("linear", "linear controllers", "every admissible finite-order dynamic linear controller", 1)
ANY = Family("any", "any controller", "every controller whatever that keeps the limits", 2)
FAMILIES = {family.key: family for family in (ANY, LINEAR, STATIC)}


def family_of(key: str) -> Family:
    """Return the class of that name.

    Raises
    ------
    InvalidInputError : there is none

    >>> family_of("linear").every
    'every admissible finite-order dynamic linear controller'
    """
    if not isinstance(key, str) or key not in FAMILIES:
        raise InvalidInputError(f"{key!r} is no class of controllers: the classes are {', '.join(map(repr, FAMILIES))}")
    return FAMILIES[key]
