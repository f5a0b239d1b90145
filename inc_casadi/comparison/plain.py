"""A comparison as plain data, the same keys for controllers and bounds: for CSV, JSON and data frames."""

from __future__ import annotations

from math import isfinite
from typing import Any

from .comparison import Comparison, label
from .floors import Floor
from .row import Row


def plain_rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Return one dictionary per controller, then one per bound; what is not known or not finite is None.

    Keys: role ("controller" or "lower bound"), name, kind, family, cost (certified, simulated or the bound), how, error
    (standard error), certified, proved (None when not tried), limits, converges, worst, gap (share above the best
    possible), seconds, reason.
    """
    bounds = [_of_floor(comparison, floor) for floor in comparison.floors]
    return [*(_of_row(comparison, row) for row in comparison.rows), *bounds]


def _of_row(comparison: Comparison, row: Row) -> dict[str, Any]:
    return {"role": "controller", "name": row.name, "kind": row.kind, "family": row.family.key,
            "cost": _number(row.cost.value), "how": row.cost.how, "error": _number(row.cost.error),
            "certified": comparison.certifies(row.name), "proved": _settled(comparison, row.name),
            "limits": row.limits.verdict, "converges": row.converges.verdict, "worst": _number(row.worst),
            "gap": _number(comparison.gap(row.name)), "seconds": row.seconds,
            "reason": "; ".join((row.limits.reason, row.converges.reason, *row.notes))}


def _of_floor(comparison: Comparison, floor: Floor) -> dict[str, Any]:
    return {"role": "lower bound", "name": label(floor), "kind": floor.family.title, "family": floor.family.key,
            "cost": _number(floor.value), "how": "dual" if floor.bound is not None else "unknown", "error": None,
            "certified": comparison.confirms(floor), "proved": _settled(comparison, label(floor)), "limits": None,
            "converges": None, "worst": None, "gap": None, "seconds": floor.seconds, "reason": floor.reason}


def _settled(comparison: Comparison, name: str) -> bool | None:
    proof = comparison.proofs.get(name)
    return None if proof is None else proof.succeeded


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None
