"""Multipliers, one file each: quadratic forms that are nonnegative on the graph of the activation."""

from ..errors import InvalidInputError
from .base import Multiplier, Unknown
from .lifted import Lifted
from .relu import Relu
from .sector import Sector
from .slope import Slope

LADDER: tuple[Multiplier, ...] = (Sector(), Slope(), Relu(), Lifted())
"""From the cheapest to the strongest: each contains the ones before it where it applies."""

__all__ = ["LADDER", "Lifted", "Multiplier", "Relu", "Sector", "Slope", "Unknown", "as_multiplier"]


def as_multiplier(value: str | Multiplier) -> Multiplier:
    """Return the multiplier of that name, or the value itself when it is one already.

    >>> as_multiplier("sector")
    Sector()
    """
    if isinstance(value, Multiplier):
        return value
    for multiplier in LADDER:
        if multiplier.name == value:
            return multiplier
    names = ", ".join(repr(multiplier.name) for multiplier in LADDER)
    raise InvalidInputError(f"multiplier is {value!r}, but must be a Multiplier or one of {names}")
