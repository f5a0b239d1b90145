"""By how much an initial set may be scaled so that a regional claim still holds from all of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..brief import Brief
from ..claims.regional import Regional
from ..errors import InvalidInputError
from ..inc import INC
from ..plant import as_plant
from ..regional_certificate import RegionalCertificate, certify_region
from ..sets import Box, Polytope, Uniform, rules
from .walk import Budget

SMALLEST, LARGEST, POINTS, STEPS = 2.0**-10, 2.0**8, 1000, 600
BLOCKS, SLOW = 20, 1e-6
STAGE = Budget(pieces=20_000, steps=2_000, seconds=20.0)
BACK = (1.0, 4.0, 16.0, 64.0)  # how far below the refuted factor is tried, in tolerances


@dataclass(frozen=True, eq=False)
class Scale(Brief):
    """The largest factor found: the claim is certified from factor * X, and refuted for `refuted` * X by a motion.

    factor: 0 when nothing was certified; certificate: of the largest set, or of the last one tried; refuted: infinite when
    no motion that fails was found; witness (n,): its starting point, or None; seconds.
    """

    factor: float
    certificate: RegionalCertificate
    refuted: float
    witness: Array | None
    seconds: float


def largest_scale(plant: Any, inc: INC, claim: Regional, *, tolerance: float = 1e-3, budget: Budget = STAGE, seed: int = 0,
                  progress: Callable[[float, bool], None] | None = None) -> Scale:
    """Return the largest factor s, to within a share `tolerance`, such that a regional claim holds from x + s (X - x).

    X is the claim's initial set and x its center. Sampled motions from the boundary of s X, the vertices among them, say
    from which s on the claim is false; just below, it is certified by exact pieces. So the answer comes with both sides: a
    certificate, and a motion that refutes a factor slightly larger.

    budget: for each certificate; seed: of the sampled motions; progress: called with (factor, certified).

    Raises what `certify` raises; InvalidInputError for a tolerance outside (0, 1).

    >>> from inc_casadi import Plant
    >>> claim = Regional(Box([-1.0], [1.0]), Box([-1.0], [1.0]), [[1.0]], [[0.0]])
    >>> found = largest_scale(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), claim)
    >>> bool(1.99 < found.factor < 2.0 <= found.refuted < 2.01)
    True
    """
    start = time.monotonic()
    plant, tolerance = as_plant(plant), number("tolerance", tolerance, 0.0, 1.0, open_low=True)
    region = claim.initial.support
    assert isinstance(region, Box | Polytope)
    edge = _boundary(region, np.random.default_rng(seed))
    first = certify_region(plant, inc, claim, budget)
    if first._structure():
        raise InvalidInputError(first.reason)
    refuted, witness = _refuted(plant, inc, claim, first, edge, tolerance)
    best, tried = None, first
    for factor in _candidates(refuted, tolerance):
        tried = certify_region(plant, inc, _scaled(claim, factor), budget)
        holds = tried.holds()
        if progress:
            progress(factor, holds)
        if holds:
            best = (factor, tried)
        if holds == np.isfinite(refuted):
            break
    factor, certificate = best or (0.0, tried)
    return Scale(factor, certificate, refuted, witness, time.monotonic() - start)


def _candidates(refuted: float, tolerance: float) -> list[float]:
    """Factors to certify: just below the refuted one, farther and farther; without one, larger and larger."""
    if np.isfinite(refuted):
        return [refuted * share for share in (*(1 - back * tolerance for back in BACK if back * tolerance < 0.5), 0.5, 0.1)]
    return list(2.0 ** np.arange(0, 9))


def _scaled(claim: Regional, factor: float) -> Regional:
    region = claim.initial.support
    center = region.center
    if isinstance(region, Box):
        larger: Box | Polytope = Box(center + factor * (region.lower - center), center + factor * (region.upper - center))
    else:
        assert isinstance(region, Polytope)
        larger = Polytope(region.H, factor * region.h + (1 - factor) * (region.H @ center))
    return Regional(Uniform(larger), claim.inputs, claim.Q, claim.R, claim.discount)


def _boundary(region: Box | Polytope, rng: np.random.Generator) -> Array:
    """Directions (n, N) from the center to points of the boundary: to the vertices, and to random points of it."""
    center = region.center[:, None]
    rays = region.sample(rules.whole("POINTS", POINTS, 1), rng) - center
    reach = np.max((region.H @ rays) / (region.h[:, None] - region.H @ center), axis=0)
    return np.hstack([region.vertices - center, rays / reach])


def _refuted(plant: Any, inc: INC, claim: Regional, first: RegionalCertificate, edge: Array,
             tolerance: float) -> tuple[float, Array | None]:
    """A factor at which some motion fails, near the smallest such, with its starting point; infinite when none is found."""
    center = claim.initial.support.center[:, None]
    low, high, witness = 0.0, 1.0, None
    while (point := _failing(plant, inc, claim, first, center + high * edge)) is None:
        low, high = high, 2 * high
        if high > LARGEST:
            return np.inf, None
    witness = point
    while high - low > 0.2 * tolerance * high and high > SMALLEST:
        middle = (low + high) / 2
        point = _failing(plant, inc, claim, first, center + middle * edge)
        if point is None:
            low = middle
        else:
            high, witness = middle, point
    return high, witness


def _failing(plant: Any, inc: INC, claim: Regional, first: RegionalCertificate, x: Array) -> Array | None:
    """A starting point among x (n, N) whose motion breaks an input limit or does not come to rest, or None.

    It rests where the motion from the center does. One that still comes nearer to that by a share SLOW in every STEPS steps
    is slow and no counterexample; it is followed for BLOCKS times as many.
    """
    terminal = first._setting[1]
    x = start = np.hstack([x, claim.initial.support.center[:, None]])
    kept, limit = np.ones(x.shape[1], dtype=bool), 1e6 * float(np.max(np.abs(x)))
    for _ in range(BLOCKS):
        before = _apart(x)
        for _ in range(STEPS):
            u = inc(plant.C @ x)
            if claim.inputs is not None:
                kept &= np.all(claim.inputs.H @ u <= claim.inputs.h[:, None] * (1 + 1e-9) + 1e-9, axis=0)
            x = np.clip(plant.A @ x + plant.B @ u, -limit, limit)
            good = kept & (terminal.contains(x.T) if terminal is not None else np.zeros(x.shape[1], dtype=bool))
            if good[:-1].all():
                return None
            if not kept.all():
                return start[:, int(np.argmin(kept))]
        stuck = ~good[:-1] & (_apart(x) > (1 - SLOW) * before)
        if stuck.any():
            return start[:, int(np.argmax(stuck))]
    return None


def _apart(x: Array) -> Array:
    """The distance of each motion from the last one."""
    return np.asarray(np.max(np.abs(x[:, :-1] - x[:, -1:]), axis=0))
