"""Plant and controller in feedback: the stacked matrices of sec:stability, and the equilibrium of a biased loop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .activations.stack import sectors, slopes
from .arrays import Array
from .blocks import exact, hstack
from .errors import DimensionError, NoEquilibriumError
from .inc import INC
from .plant import Plant, as_plant

Cone = tuple[tuple[float, float] | None, ...]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The loop in the stacked variable s = (x, eta): x+ (or dx/dt) = F s, u = G s, z = Z s, x = X s, eta = H s.

    F (n, n+q), G (m, n+q), Z (q, n+q), X (n, n+q), H (q, n+q) of eq:s_stack, eq:Z_def, eq:F_def, eq:G_def, eq:Fc_def.
    lower, upper (q,): the diagonals of D0 and D1. cone: for each unit (slope for z <= 0, slope for z >= 0), or None.

    When the controller preserves the origin, s is the state itself, D0 and D1 are the sectors
    (Assumption ass:sector) and `cone` states which units are linear on both half lines. Otherwise s is the deviation from
    an equilibrium, D0 and D1 are the slope ranges (Assumption ass:incremental_sector) and no unit has a cone.
    """

    plant: Plant
    inc: INC
    F: Any
    G: Any
    Z: Any
    X: Any
    H: Any
    lower: Any
    upper: Any
    cone: Cone

    @property
    def n(self) -> int:
        """Number of states."""
        return self.plant.n

    @property
    def q(self) -> int:
        """Number of hidden units."""
        return self.inc.q

    def exact(self) -> ClosedLoop:
        """Return the same loop in Fractions, formed without rounding from the stored floats of plant and controller."""
        plant, inc = self.plant, self.inc
        parts = [exact(part) for part in (plant.A, plant.B, plant.C, inc.W, inc.U, inc.V, inc.K)]
        F, G, Z, X, H = stacked_matrices(*parts)
        cone = tuple(None if ends is None else tuple(exact(np.array(ends))) for ends in self.cone)
        return replace(self, F=F, G=G, Z=Z, X=exact(X), H=exact(H), lower=exact(self.lower), upper=exact(self.upper),
                       cone=cone)


def stacked_matrices(A: Any, B: Any, C: Any, W: Any, U: Any, V: Any, K: Any) -> tuple[Any, Any, Any, Array, Array]:
    """Return F, G, Z, X, H for matrices of any kind that `blocks` knows; X and H are floats.

    >>> one = np.ones((1, 1))
    >>> stacked_matrices(one, one, one, 0 * one, one, one, 3 * one)[0].tolist()
    [[4.0, 1.0]]
    """
    n, q = A.shape[0], W.shape[0]
    F = hstack(A + B @ K @ C, B @ V)
    G = hstack(K @ C, V)
    Z = hstack(U @ C, W)
    return F, G, Z, np.eye(n, n + q), np.eye(q, n + q, n)


def close_loop(plant: Plant, inc: INC) -> ClosedLoop:
    """Return the loop of a plant and a controller.

    plant: a Plant or a control.StateSpace. Raises DimensionError when the sizes do not fit.

    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0))
    >>> loop.F.tolist(), loop.Z.tolist()
    ([[1.5, 1.0]], [[-1.5, 0.0]])
    """
    plant = as_plant(plant)
    if (inc.p, inc.m) != (plant.p, plant.m):
        raise DimensionError(f"the controller maps {inc.p} measurements to {inc.m} inputs, but the plant has "
                             f"{plant.p} measurements and {plant.m} inputs")
    F, G, Z, X, H = stacked_matrices(plant.A, plant.B, plant.C, inc.W, inc.U, inc.V, inc.K)
    if inc.preserves_origin:
        ends = sectors(inc.activations)
        assert ends is not None
        cone: Cone = tuple(unit.homogeneous for unit in inc.activations)
    else:
        ends, cone = slopes(inc.activations), (None,) * inc.q
    return ClosedLoop(plant, inc, F, G, Z, X, H, *ends, cone)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A point where the loop rests (eq:equilibrium_incremental): x (n,), u (m,), y (p,), z (q,), eta (q,).

    residual: the largest |A x + B u - x|, or |A x + B u| in continuous time.
    """

    x: Array
    u: Array
    y: Array
    z: Array
    eta: Array
    residual: float


def equilibrium(plant: Plant, inc: INC, *, tolerance: float = 1e-10) -> Equilibrium:
    """Return an equilibrium of the loop, by damped Newton steps on A x + B inc(C x) - x (discrete) from the origin.

    Each step uses the controller's Jacobian and is halved until the residual falls. A law with several
    equilibria gives the one that is found first.

    Raises NoEquilibriumError with the smallest residual found.

    >>> equilibrium(Plant([[0.5]], [[1.0]]), INC(np.zeros((0, 0)), [], [], [[0.0]], d=[1.0])).x.round(9).tolist()
    [2.0]
    """
    plant = close_loop(plant, inc).plant
    shift = plant.A - np.eye(plant.n) if plant.discrete else plant.A
    x = np.zeros(plant.n)
    gap = shift @ x + plant.B @ inc(plant.C @ x)
    for _ in range(200):
        if np.max(np.abs(gap)) <= tolerance * (1.0 + np.max(np.abs(x))):
            break
        step = np.linalg.lstsq(shift + plant.B @ inc.jacobian(plant.C @ x) @ plant.C, -gap, rcond=None)[0]
        for length in 0.5 ** np.arange(20):
            trial = x + length * step
            trial_gap = shift @ trial + plant.B @ inc(plant.C @ trial)
            if np.linalg.norm(trial_gap) < (1 - 1e-3 * length) * np.linalg.norm(gap):
                break
        else:
            break
        x, gap = trial, trial_gap
    worst = float(np.max(np.abs(gap)))
    if worst > tolerance * (1.0 + np.max(np.abs(x))):
        raise NoEquilibriumError(f"no equilibrium of the biased loop was found: Newton from the origin stopped at a "
                                 f"residual of {worst:.3g}")
    y = plant.C @ x
    eta = inc.hidden(y)
    return Equilibrium(x, inc(y), y, inc.W @ eta + inc.U @ y + inc.b, eta, worst)
