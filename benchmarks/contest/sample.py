"""Records made by hand, for examples and tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .record import Entry, Environment, LowerBound, PlantRecord
from .settings import SYNTHESIZED, Settings

NOWHERE = Environment({"python": "3.11.0", "numpy": "2.0.0"}, "s", "abc", 2, 8.0, "Linux x86_64", "2000-01-01 00:00 UTC")


def entry(name: str, cost: float | None, **known: Any) -> Entry:
    """Return a certified controller of that exact cost with one hidden unit, but for what is `known` otherwise."""
    usual: dict[str, Any] = {"kind": "neural, 1 unit", "units": 1, "cost": cost, "how": "exact", "certified": True,
                             "limits": "certified", "design": 1.0, "judged": 0.5, "evaluation": 50.0}
    return Entry(name, **usual | known)


def record(cost: float | None, rivals: Mapping[str, float], floor: float | None = 1.0, plant: str = "made up",
           **known: Any) -> PlantRecord:
    """Return the record of a plant: the synthesized law's cost, its rivals', the lower bound on any controller.

    >>> record(2.0, {"saturated LQR": 2.5}).entry("saturated LQR").cost
    2.5
    """
    def gap(value: float | None) -> float | None:
        return None if value is None or floor is None else value / floor - 1

    own = {} if cost is None else {SYNTHESIZED: cost}
    entries = tuple(entry(name, value, gap=gap(value)) for name, value in {**own, **rivals}.items())
    usual: dict[str, Any] = {"sizes": (2, 1, 1), "source": "nowhere", "digest": "d", "settings": Settings(),
                             "environment": NOWHERE, "entries": entries,
                             "bounds": (LowerBound("any", floor, floor is not None),), "seconds": 3.0}
    return PlantRecord(plant, **usual | known)
