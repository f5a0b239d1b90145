"""The way of proof for laws that are clipped for a few moves only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import INCError
from ..linear.clipped_cost import clipped_cost
from .findings import BUILT_IN, Finding, Passed, Question

CLIPPED = "bounded clipping"
WORDS = "bounds on what each move may clip, until none does"
LOOSE = 1.02  # times what the linear loop costs; a bound above that may be improved on in other ways
MOST_FOLLOWED = 8  # states up to which exact pieces give the expected cost, so that they are asked first


def by_clipping(asked: Question, before: Sequence[Finding], until: float) -> Finding | None:
    """Bound the cost of a law that is linear but for a few moves (`ClippedCost`): close where clipping is rare.

    Before exact pieces where these give the largest cost only, after them, where they give nothing, elsewhere. None where it
    does not apply or leaves open whether clipping ends; it takes milliseconds at any number of states.
    """
    followed = any(one.way == "exact pieces" for one in before)
    if followed == (asked.plant.n > MOST_FOLLOWED):
        return None
    try:
        found = clipped_cost(asked.plant, asked.spec, asked.inc)
        if found.reason:
            return None
    except INCError:
        return None
    costs = "expected and worst cost" if np.isfinite(found.worst_bound) else "expected cost"
    proofs = [f"converges from every initial state: {WORDS}", f"{costs}: at most so much, by the same bounds"]
    if asked.spec.inputs is not None:
        proofs.insert(0, f"input limits kept on every motion: {BUILT_IN}")
    worst = found.worst_bound if np.isfinite(found.worst_bound) else np.nan
    return Passed(CLIPPED, found, WORDS, BUILT_IN if asked.spec.inputs is not None else WORDS, WORDS, worst,
                  loose=found.bound > LOOSE * found.linear, proofs=tuple(proofs))
