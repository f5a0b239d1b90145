"""Controllers judged, each by its own certificate or by `compare`, and set beside the lower bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from inc_casadi import INC
from inc_casadi.certificate import Proof
from inc_casadi.comparison import Comparison, compare
from inc_casadi.comparison.row import EXACT, Row
from inc_casadi.linear import LinearController
from inc_casadi.pieces.walk import Budget

from .floors import floors
from .isolation import attempted, words
from .settings import SYNTHESIZED
from .work import TOO_LATE, Design, Work

SAME = "it is the synthesized INC, number by number, whose certificate is used"


def compared(work: Work, designs: Sequence[Design]) -> Comparison:
    """Return all controllers and bounds as one comparison; bounds that `synthesize` worked out are among them."""
    made = [one for one in designs if one.result is not None]
    known = made[0].result.comparison().floors if made else ()
    proofs = {one.name: one.proof for one in designs if isinstance(one.proof, Proof)}
    rows: list[Row] = []
    for one in designs:
        with work.stages.during("judging"):
            begun = process_time()
            row = _row(work, one, rows[0] if rows and designs[0].name == SYNTHESIZED else None)
            rows.append(replace(row, seconds=process_time() - begun))
    with work.stages.during("bounds"):
        found = (*known, *floors(work.case, work.settings, known))
    return Comparison(work.case.plant, work.case.spec, tuple(rows), found, proofs)


def same_law(one: Any, other: Any) -> bool:
    """Return whether two controllers are static laws with the same numbers and activations.

    >>> same_law(INC.saturated([[-1.0]], 1.0), INC.saturated([[-1.0]], 1.0)), same_law(INC.linear([[1.0]]), [[1.0]])
    (True, False)
    """
    if not isinstance(one, INC) or not isinstance(other, INC) or one.q != other.q:
        return False
    alike = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("W", "U", "V", "K", "b", "d"))
    return alike and all(type(a) is type(b) and vars(a) == vars(b)
                         for a, b in zip(one.activations, other.activations, strict=True))


def _row(work: Work, design: Design, own: Row | None) -> Row:
    """What is known of a controller, by its certificate when it brings one; own: the row of the synthesized law."""
    if design.result is not None:
        rows = design.result.comparison().rows
        return replace(rows[0], name=design.name) if rows else Row(design.name, None, "not found")
    if design.law is None:
        return Row(design.name, None, design.kind, notes=(design.reason,))
    if own is not None and own.certified and same_law(own.controller, design.law):
        return replace(own, name=design.name, notes=(SAME,))
    found = TOO_LATE if work.over else attempted(partial(_judged, work, design.name, design.law))
    if isinstance(found, BaseException):
        return Row(design.name, design.law, type(design.law).__name__, notes=(words(found),))
    row: Row = found
    return row


def _judged(work: Work, name: str, law: Any) -> Row:
    """What `compare` says; of a linear gain the Lyapunov equation is asked where pieces give no exact cost, as for n > 8."""
    settings = work.settings

    def row(one: Any) -> Row:
        return compare(work.case.plant, work.case.spec, {name: one}, bounds=(), seed=settings.seed,
                       budget=Budget(seconds=settings.pieces), samples=settings.samples).rows[0]

    found = row(law)
    if found.cost.how == EXACT or not isinstance(law, INC) or law.q or np.any(law.d):
        return found
    other = row(LinearController.static(law.K))
    return other if other.bound < found.bound else found
