"""The local methods by name."""

from __future__ import annotations

from ..errors import InvalidInputError
from .base import LocalMethod
from .convex_hull import ConvexHull
from .dead_zone import DeadZone
from .linear import Linear
from .polytope import PolytopeRows
from .sectors import LocalSectors

METHODS: tuple[LocalMethod, ...] = (Linear(), ConvexHull(), DeadZone(), PolytopeRows(), LocalSectors())
"""All local methods, the cheapest first; add one to have it tried."""


def method_of(name: str) -> LocalMethod:
    """Return the local method with a name.

    Raises InvalidInputError for a name that is not one.

    >>> method_of("linear").name
    'linear'
    """
    for method in METHODS:
        if method.name == name:
            return method
    raise InvalidInputError(f"method is {name!r}, but must be one of {', '.join(repr(m.name) for m in METHODS)}")
