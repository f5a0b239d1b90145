"""The way of proof for laws that never leave their linear piece: linear ones, and clipped ones that are never clipped."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import INCError
from ..linear.unswitched_cost import SETTLED, UnswitchedCost, unswitched_cost
from .causes import Cause
from .findings import BUILT_IN, Finding, Passed, Question, Refused

LYAPUNOV = "Lyapunov"
SAMPLES = 64  # initial states at which a switch is looked for before anything is solved in fractions
WORDS = "a Lyapunov inequality of the affine piece that no motion leaves"


def by_lyapunov(asked: Question, before: Sequence[Finding], until: float) -> Finding | None:
    """Bound the cost by a Lyapunov inequality where no unit switches on any motion (`UnswitchedCost`): the cost itself.

    None where a unit is curved or switches, for then the law is not of this kind; a law without units is, and is refused
    with its reason. It takes milliseconds at any number of states.
    """
    if not asked.plant.discrete or _switches_at_once(asked):
        return None
    try:
        certificate = unswitched_cost(asked.plant, asked.spec, asked.inc)
        reason = certificate.reason
    except INCError:
        return None
    if reason:
        linear = not asked.inc.without_idle_units().q
        cause = Cause.LIMITS if "leaves facet" in reason else Cause.HOPELESS
        return Refused(LYAPUNOV, reason, cause, certificate) if linear else None
    return _unswitched(asked, certificate)


def _unswitched(asked: Question, certificate: UnswitchedCost) -> Passed:
    worst = certificate.worst_bound
    costs = "expected cost" if np.isinf(worst) else "expected and worst cost"
    proofs = [f"converges from every initial state: {WORDS}", f"{costs}: the same inequality"]
    if asked.spec.inputs is not None:
        kept = "the first moves by supports, those to come by a Lyapunov inequality"
        proofs.insert(0, "input limits kept on every motion: " + (BUILT_IN if asked.built_in else kept))
    worst = worst if np.isfinite(worst) else np.nan
    return Passed(LYAPUNOV, certificate, WORDS, WORDS, WORDS, worst, certificate.gap <= SETTLED * certificate.bound,
                  proofs=tuple(proofs))


def _switches_at_once(asked: Question) -> bool:
    """Whether a sampled initial state makes a unit switch at the first move: then no more is worth looking at.

    It decides what is tried and proves nothing.
    """
    law = asked.inc.without_idle_units()
    if not law.q or any(unit.pieces is None for unit in law.activations):
        return bool(law.q)
    x = asked.spec.initial.sample(SAMPLES, np.random.default_rng(0))
    y = np.hstack([np.zeros((law.p, 1)), asked.plant.C @ x])
    try:
        levels = law.W @ law.hidden(y) + law.U @ y + law.b[:, None]
    except INCError:
        return True
    pieces = [unit.pieces for unit in law.activations if unit.pieces is not None]
    at = np.stack([piece.index(row) for piece, row in zip(pieces, levels, strict=True)])
    return bool(np.any(at != at[:, :1]))
