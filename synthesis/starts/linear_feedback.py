"""Starts from static linear feedback of the measurement: stabilizing, saturated, and one that is certified."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Any

from inc_casadi.arrays import Array
from inc_casadi.brief import Brief
from inc_casadi.certificate import Certificate
from inc_casadi.errors import INCError, InvalidInputError, NotCertifiedError
from inc_casadi.estimate import estimate
from inc_casadi.inc import INC
from inc_casadi.linear.static_gain import best_static_gain
from inc_casadi.pieces.walk import Budget
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.spec import Spec

from ..gate import gate

SHARES = (0.75, 0.5, 0.25)
SAMPLES = 1000
PIECES, STEPS = 20_000, 500  # of each regional proof; half as many pieces for each state beyond two, for their vertices


@dataclass(frozen=True, eq=False)
class CertifiedStart(Brief):
    """u = sat(F y) with a certificate that holds.

    inc: with the limits built in; F (m, p): the gain, for `linear_start`; label: which of the gains it is; cost: the
    certified one; certificate; refused: (label, reason) of gains that simulate better and failed.
    """

    inc: INC
    F: Array
    label: str
    cost: float
    certificate: Certificate
    refused: tuple[tuple[str, str], ...]


def stabilizing_gain(plant: Any, spec: Spec, seed: int = 0) -> Array:
    """Return F (m, p) of the best static gain u = F y found, as if there were no input limits.

    With limits it is to be saturated: the gain that keeps them on the initial set is slower (`best_static_gain`).

    Raises InfeasibleError where no such gain was found or an unstable mode is not measured; NotStabilizableError.

    >>> spec = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> stabilizing_gain(Plant(1.5, 1.0), spec).round(4).tolist()
    [[-1.5]]
    """
    return best_static_gain(plant, replace(spec, inputs=None), seed=seed).F


def certified_linear_start(plant: Any, spec: Spec, seconds: float = inf, seed: int = 0) -> CertifiedStart:
    """Return u = sat(F y) that the gate certifies, the best by simulation among a few gains F.

    F = t F_free + (1 - t) F_kept, t = 1, 3/4, ..., 0: F_free is the best gain found without limits, F_kept the best that
    keeps them on the initial set; without one the gains are t F_free. One more is the best without limits and discount,
    which stabilizes where a discounted one need not. They are tried in the order of their simulated costs, those last whose
    motions do not come to rest. The certificate is the exact regional one or the
    global inequality (`gate`), recomputed from its numbers. A search that keeps the best certified law cannot lose it.

    Parameters
    ----------
    plant : discrete time
    spec : spec.inputs a Box or None
    seconds : for the regional proof of each gain; by default only its pieces and steps are limited, which makes the answer
        the same on every machine
    seed : of the searches for gains and of simulation

    Raises
    ------
    InvalidInputError : continuous time, or inputs a Polytope
    InfeasibleError, NotStabilizableError : there is no stabilizing gain to begin with
    NotCertifiedError : none of the gains is certified, each with its reason

    >>> spec = Spec(Q=1.0, R=0.0, discount=0.9, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> start = certified_linear_start(Plant(1.5, 1.0), spec)
    >>> start.F.round(4).tolist(), round(start.cost, 6), start.certificate.holds()  # 1 / 3 + 0.9 / 36
    ([[-1.5]], 0.358333, True)
    """
    plant = as_plant(plant)
    spec.check(plant)
    if not plant.discrete:
        raise InvalidInputError("the gate follows motions in discrete time, but the plant is continuous: plant.sampled(dt)")
    if spec.inputs is not None and not isinstance(spec.inputs, Box):
        raise InvalidInputError("the inputs are a Polytope, and a saturated gain is clipped to a Box")
    refused: list[tuple[str, str]] = []
    for label, F, inc in _by_cost(plant, spec, _gains(plant, spec, seed), seed):
        verdict = gate(plant, spec, inc, Budget(_pieces(plant.n), STEPS, seconds))
        if verdict.certificate is not None:
            return CertifiedStart(inc, F, label, verdict.cost, verdict.certificate, tuple(refused))
        refused.append((label, "; ".join(verdict.refusals)))
    reasons = " ".join(f"{label}: {why}." for label, why in refused)
    raise NotCertifiedError(f"no saturated linear gain is certified. {reasons}")


def _pieces(n: int) -> int:
    return max(100, PIECES // 2 ** max(0, n - 2))


def _gains(plant: Plant, spec: Spec, seed: int) -> list[tuple[str, Array]]:
    free = stabilizing_gain(plant, spec, seed)
    gains = [("free", free)]
    if spec.discount < 1:
        gains.append(("undiscounted", stabilizing_gain(plant, replace(spec, discount=1.0), seed)))
    if spec.inputs is None:
        return gains
    try:
        kept = best_static_gain(plant, spec, seed=seed).F
    except INCError:  # no gain keeps the limits on the initial set: less of the free one saturates less
        return gains + [(f"{share:g} free", share * free) for share in SHARES]
    mixed = [(f"{share:g} free + {1 - share:g} kept", share * free + (1 - share) * kept) for share in SHARES]
    return [*gains, *mixed, ("kept", kept)]


def _by_cost(plant: Plant, spec: Spec, gains: list[tuple[str, Array]], seed: int) -> list[tuple[str, Array, INC]]:
    laws = [(label, F, _saturated(F, spec)) for label, F in gains]
    runs = [estimate(plant, law, spec, samples=SAMPLES, seed=seed) for _, _, law in laws]
    order = sorted(range(len(laws)), key=lambda i: (not runs[i].settled, runs[i].mean))
    return [laws[i] for i in order]


def _saturated(F: Array, spec: Spec) -> INC:
    law = INC.linear(F)
    return law.with_saturated_output(spec.inputs) if isinstance(spec.inputs, Box) else law
