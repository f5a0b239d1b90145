"""How far a rounded walk can be from the true motions, and what that does to its verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..activations.stack import lipschitz
from ..arrays import Array
from ..claims.regional import Regional
from .laws import PiecewiseLoop
from .terminal import TerminalSet

GUARD = 1 + 1e-6
LEVEL_ROOM, ERROR_ROOM = 2.0**-40, 2.0**-84


@dataclass(frozen=True, eq=False)
class Step:
    """What one step of a walk did, as the error bound needs it: floats rounded up.

    rounds: how many times the deepest simplex was cut; beyond: how far a z of a simplex that counted as whole lay
    beyond its piece; x (n,), u (m,): the largest magnitudes at the vertices; slack: the smallest h - H u.
    """

    rounds: int
    beyond: float
    x: Array
    u: Array
    slack: object


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Bounds on the difference between a rounded walk and the true motions from the same starting points.

    state (k, n): |x_k - what the walk says| at the start of step k; inputs (k, m) likewise for u; cost: what all this can
    change in the discounted cost from any starting point.
    """

    state: Array
    inputs: Array
    cost: float

    def limit_kept(self, claim: Regional, steps: Sequence[Step]) -> bool:
        """Whether every h - H u found leaves room for the error of u."""
        if claim.inputs is None:
            return True
        need = GUARD * np.max(self.inputs @ np.abs(claim.inputs.H).T, axis=1, initial=0.0)
        return all(step.slack >= room for step, room in zip(steps, need, strict=True))  # type: ignore[operator]

    def arrives(self, terminal: TerminalSet) -> bool:
        """Whether a vertex within (1 - 2^-40) of the terminal level stays within it whatever the error.

        sqrt(e'P e) changes by at most sqrt(E'|P|E), and sqrt(1 - 2^-40) + 2^-42 < 1.
        """
        P = np.abs(terminal.P.astype(float))
        size = np.einsum("ki,ij,kj->k", self.state, P, self.state)
        return bool(np.all(GUARD * size <= ERROR_ROOM * float(terminal.level)))  # type: ignore[arg-type]


def enclose(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, steps: Sequence[Step],
            resolution: float) -> Enclosure:
    """Return bounds on the error of a walk whose numbers are multiples of `resolution`, rounded down each time.

    Let E_k >= |x_k(l) - xhat_k(l)| for all barycentric coordinates l of all simplices, E_0 = 0. Within a step:

    * a cut puts its new vertex on the edge up to one rounding, so after c rounds E' = E + c resolution;
    * the law used is the exact law of its pattern up to r = 2 resolution (1 + sum |x|), and every z lies in its piece
      up to t = beyond + r. The law's eta then solves eta = phi(z) up to 2 S t, S the largest slopes, because phi departs
      from the piece's line by at most its change of slope times t. With S|W| v <= rate v, the true eta at the same
      point is within v max_i(2 S_i t / v_i) / (1 - rate) of it (contraction of thm:wellposed);
    * the controller answers a state error E' by at most |K||C|E' + |V| v max_i((S|U||C|E')_i / v_i) / (1 - rate).

    Both together bound the error of u, and E+ = |A| E' + |B| error(u) + resolution. A quadratic x'Q x changes by at most
    2 |x|'|Q|E + E'|Q|E. All numbers here are nonnegative floats; each line is inflated by 1e-6, far more than rounding.
    """
    plant, inc = loop.plant, loop.inc
    A, B, C = np.abs(plant.A), np.abs(plant.B), np.abs(plant.C)
    U, V, K, S = np.abs(inc.U), np.abs(inc.V), np.abs(inc.K), lipschitz(inc.activations)
    test = inc.well_posedness()
    room = (1.0 - test.rate * GUARD if test.rate else 1.0) / GUARD

    def hidden(residual: Array) -> Array:
        return GUARD * test.weights * np.max(residual / test.weights, initial=0.0) / room

    E, cost = np.zeros(plant.n), 0.0
    state, inputs = [E], []
    for step in steps:
        E = GUARD * (E + step.rounds * resolution)
        law = 2 * resolution * (1 + step.x.sum())
        error = GUARD * (K @ (C @ E) + V @ (hidden(S * (U @ (C @ E))) + hidden(2 * S * (step.beyond + law))) + law)
        cost += GUARD * (_change(claim.Q, step.x, E) + _change(claim.R, step.u, error))
        E = GUARD * (A @ E + B @ error + resolution)
        state.append(E)
        inputs.append(error)
    lifted = np.append(np.max([step.x for step in steps], axis=0, initial=0.0) + np.abs(terminal.x.astype(float)), 1.0)
    reach = np.append(np.max(state, axis=0), 0.0) + resolution
    cost += GUARD * _change(terminal.tail.astype(float), lifted, reach)
    return Enclosure(np.array(state), np.array(inputs).reshape(len(steps), plant.m), cost)


def _change(weight: Array, size: Array, error: Array) -> float:
    return float((2 * size + error) @ np.abs(weight) @ error)
