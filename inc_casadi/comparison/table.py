"""The table of a comparison: controllers, lower bounds, and the sentences that follow."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import isfinite, isnan

from ..figures import at_least, at_most
from .comparison import Comparison, label
from .floors import Floor
from .row import CERTIFIED, NOTHING, SIMULATED, VIOLATED, Row
from .sentences import percent
from .statements import ASSUMED, NOT_CLAIMED, bound_grounds, cost_grounds

HEADINGS = ("controller", "kind", "expected cost", "how known", "limits kept", "converges", "above the best", "seconds")


def table(comparison: Comparison) -> str:
    """Return the comparison as text: one line per controller and per bound, reasons, and what follows."""
    lines = list(columns([HEADINGS, *(_cells(comparison, row) for row in comparison.rows)]))
    lines += ["", *(_bound_line(comparison, floor) for floor in comparison.floors)]
    found = comparison.statements
    lines += ["", *(statement.claim for statement in found)]
    if not any(statement.separates for statement in found):
        lines.append("No controller is shown to beat a class of competitors here.")
    lines += [f"Not settled rigorously, {name}: {proof.reason}." for name, proof in comparison.proofs.items() if not proof]
    if any(statement.grounds for statement in found):
        lines += ["", *_grounds(comparison), ASSUMED, NOT_CLAIMED]
    lines += [f"INCONSISTENT: {inversion}." for inversion in comparison.inversions()]
    return "\n".join(lines)


def _grounds(comparison: Comparison) -> Iterable[str]:
    for row in comparison.rows:
        if comparison.certifies(row.name):
            yield f"{row.name} rests on: {cost_grounds(comparison, row)}."
    for floor in comparison.floors:
        if floor.bound is not None:
            yield f"{label(floor)} rests on: {bound_grounds(comparison, floor)}."


def columns(rows: Sequence[Sequence[str]]) -> Iterable[str]:
    """Return rows of cells as lines with aligned columns.

    >>> list(columns([("a", "b"), ("ccc", "d")]))
    ['a    b', 'ccc  d']
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows)


def _cells(comparison: Comparison, row: Row) -> tuple[str, ...]:
    gap = comparison.gap(row.name)
    settled = bool(comparison.proofs.get(row.name))
    return (row.name, row.kind, figure(row), how(comparison, row), _verdict(row.limits.verdict, settled),
            _verdict(row.converges.verdict, settled), "" if isnan(gap) else f"at most {percent(gap)}",
            f"{row.seconds:.2f}")


def figure(row: Row) -> str:
    """Return the cost in digits, rounded up where it is certified.

    >>> figure(Row("none", None, "callable law"))
    '-'
    """
    cost = row.cost
    if isnan(cost.value):
        return "-"
    if not isfinite(cost.value):
        return "infinite"
    if cost.how == SIMULATED:
        return f"{cost.value:.5g} +- {cost.error:.2g}"
    return at_most(cost.value) if cost.evidence is not None else f"{cost.value:.7g}"


def how(comparison: Comparison, row: Row) -> str:
    """Return how the cost is known, in words."""
    kind = row.cost.how
    if kind == SIMULATED:
        return f"simulated, {row.cost.words}"
    if kind == NOTHING:
        return ""
    if comparison.certifies(row.name):
        return f"{kind}, {'proved' if comparison.proofs.get(row.name) else 'certified'}"
    if row.limits.verdict == VIOLATED:
        return f"{kind}, limits violated"
    return f"{kind}, {'not certified' if row.cost.evidence is None else 'limits not certified'}"


def _verdict(verdict: str, settled: bool) -> str:
    return "proved" if settled and verdict == CERTIFIED else verdict


def _bound_line(comparison: Comparison, floor: Floor) -> str:
    if floor.bound is None:
        return f"{label(floor)}: none, {floor.reason}"
    proof = comparison.proofs.get(label(floor))
    held = "holds" if comparison.confirms(floor) else "NOT CONFIRMED by its stored numbers"
    words = "proved" if proof else held
    return f"{label(floor)}: at least {at_least(floor.value)}, {words}, {floor.seconds:.2f} s"
