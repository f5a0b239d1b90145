"""How far a rounded walk can be from the true motions, and what that does to its verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..activations.stack import lipschitz, slopes
from ..arrays import Array
from ..claims.regional import Regional
from ..well_posed import error_from_residual
from .fixed import RESOLUTION
from .laws import PiecewiseLoop
from .simplices import Simplices
from .terminal import TerminalSet

GUARD = 1 + 1e-6
LEVEL_ROOM, ERROR_ROOM = 2.0**-40, 2.0**-84


@dataclass(frozen=True, eq=False)
class Step:
    """What one step of a walk did, as the error bound needs it.

    rounds: how many times the deepest simplex was cut; beyond: how far a z of a simplex that counted as whole lay
    beyond its piece; x (n,), u (m,): the largest magnitudes at the vertices; slack: the smallest h - H u; largest: the
    largest magnitude in laws and cost forms; pieces: how many simplices moved on.
    """

    rounds: int
    beyond: float
    x: Array
    u: Array
    slack: Any
    largest: float
    pieces: int


@dataclass(frozen=True, eq=False)
class Arrival:
    """Where a walk ended: how many pieces, the largest magnitudes of their vertices x (n,) and of their cost forms."""

    pieces: int
    x: Array
    largest: float

    @classmethod
    def of(cls, done: Simplices) -> Arrival:
        """Return what an error bound needs to know of the simplices that arrived."""
        x = np.abs(done.now).max(axis=(0, 1)).astype(float)
        return cls(len(done), x, float(np.max(np.abs(done.cost))))


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Bounds on the difference between a rounded walk and the true motions from the same starting points.

    state (k + 1, n): |x_k - what the walk says| at the start of each step; inputs (k, m) likewise for u; cost: what all
    this can change in the expected cost and in the discounted cost from any starting point; rounding: what one
    rounded formula can be off by.
    """

    state: Array
    inputs: Array
    cost: float
    rounding: float

    def keeps_limits(self, claim: Regional, steps: Sequence[Step]) -> bool:
        """Whether every h - H u found leaves room for the error of u."""
        if claim.inputs is None:
            return True
        need = GUARD * (self.inputs @ np.abs(claim.inputs.H).T + self.rounding)
        return all(float(step.slack) >= room for step, room in zip(steps, need.max(axis=1), strict=True))

    def arrives(self, terminal: TerminalSet) -> bool:
        """Whether a vertex within (1 - 2^-40) of the terminal level stays within it whatever the error.

        sqrt(e'P e) changes by at most sqrt(E'|P|E), and sqrt(1 - 2^-40) + 2^-42 < 1.
        """
        size = np.einsum("ki,ij,kj->k", self.state, np.abs(terminal.P.astype(float)), self.state) + self.rounding
        return bool(np.all(GUARD * size <= ERROR_ROOM * float(terminal.level)))


def enclose(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, steps: Sequence[Step], arrival: Arrival,
            resolution: float = RESOLUTION) -> Enclosure:
    """Return bounds on the error of a walk over simplices in numbers that are rounded down to multiples of `resolution`.

    Every formula of a walk is a sum of at most N = 64 (n + m + p + q + 2)^2 products of at most four numbers below
    M >= 1, so its rounding is at most r = N M^3 resolution. Let E_k >= |x_k(l) - xhat_k(l)| for all barycentric
    coordinates l of all simplices, E_0 = r. Within a step:

    * a cut puts its new vertex on the edge up to r, so after c rounds of cutting E' = E + c r. Where on the edge it is put
      does not matter: that share of the edge defines the cut of the starting points too;
    * the law used is the exact law of its pattern up to r, and every z lies in its piece up to t = beyond + r. The law's
      eta then solves eta = phi(z) up to 2 S t, S the largest slopes, because phi departs from the piece's line by at
      most its change of slope times t. The true eta at the same point is within e(2 S t) of it, where e bounds the error
      that a residual leaves (`error_from_residual`): v max_i(2 S_i t / v_i) / (1 - rate) if S|W| v <= rate v, by the
      contraction of thm:wellposed; under a multiplier T what its strong monotonicity allows;
    * the true eta at a point off by E' solves the equation of this point up to S|U||C|E', so the controller answers a state
      error E' by at most |K||C|E' + |V| e(S|U||C|E').

    Both together bound the error of u, and E+ = |A| E' + |B| error(u) + r. A quadratic x'Q x changes by at most
    2 |x|'|Q|E + E'|Q|E; weights, cost forms and powers of the discount are off by r for each rounding that made them. All
    numbers here are nonnegative floats; each line is inflated by 1e-6, far more than its own rounding.
    """
    plant, inc = loop.plant, loop.inc
    A, B, C = np.abs(plant.A), np.abs(plant.B), np.abs(plant.C)
    U, V, K, S = np.abs(inc.U), np.abs(inc.V), np.abs(inc.K), lipschitz(inc.activations)
    test, ends = inc.well_posedness(), slopes(inc.activations)
    if not np.all(np.isfinite(error_from_residual(test, inc.W, ends, S, GUARD))):
        return Enclosure(np.full((len(steps) + 1, plant.n), np.inf), np.full((len(steps), plant.m), np.inf), np.inf, np.inf)
    r = _rounding(loop, claim, terminal, steps, arrival, resolution)

    def hidden(residual: Array) -> Array:
        return error_from_residual(test, inc.W, ends, residual, GUARD)

    E, cost = np.full(plant.n, r), 0.0
    state, inputs = [E], []
    for step in steps:
        E = GUARD * (E + step.rounds * r)
        error = GUARD * (K @ (C @ E) + V @ (hidden(S * (U @ (C @ E))) + hidden(2 * S * (step.beyond + r))) + r)
        cost += GUARD * (_change(claim.Q, step.x, E) + _change(claim.R, step.u, error))
        E = GUARD * (A @ E + B @ error + r)
        state.append(E)
        inputs.append(error)
    lifted = np.append(arrival.x + np.abs(terminal.x.astype(float)), 1.0)
    cost += GUARD * _change(terminal.tail.astype(float), GUARD * lifted, np.append(np.max(state, axis=0) + r, 0.0))
    depth = sum(step.rounds for step in steps) + 2
    cost += GUARD * r * (arrival.pieces * depth + (len(steps) + depth) ** 2)
    return Enclosure(np.array(state), np.array(inputs).reshape(len(steps), plant.m), cost, r)


def _rounding(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, steps: Sequence[Step],
              arrival: Arrival, resolution: float) -> float:
    """What one formula of the walk can be off by: N M^3 resolution, doubled."""
    plant, inputs = loop.plant, claim.inputs
    arrays = [plant.A, plant.B, plant.C, claim.Q, claim.R, terminal.P, terminal.tail, terminal.x, terminal.level,
              arrival.x, arrival.largest]
    arrays += [] if inputs is None else [inputs.H, inputs.h]
    arrays += [part for step in steps for part in (step.x, step.u, step.largest)]
    arrays.append(claim.initial.vertices)
    M = max(float(np.max(np.abs(np.asarray(part).astype(float)), initial=1.0)) for part in arrays)
    N = 64 * (plant.n + plant.m + plant.p + loop.inc.q + 2) ** 2
    return 2 * N * M**3 * resolution


def _change(weight: Array, size: Array, error: Array) -> float:
    return float((2 * size + error) @ np.abs(weight) @ error)
