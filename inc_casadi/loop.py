"""Plant and controller in feedback: the stacked matrices of sec:stability, and the equilibrium of a biased loop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .activations.stack import sectors, slopes
from .arrays import Array
from .blocks import hstack
from .brief import Brief
from .errors import DimensionError, NoEquilibriumError
from .inc import INC
from .plant import Plant, as_plant
from .readings import Reading


@dataclass(frozen=True, eq=False)
class ClosedLoop(Brief):
    """The loop over a stacked variable s, at first s = (x, eta): F s is x+ (or dx/dt), u = G s, z = Z s, x = X s, eta = H s.

    F (n, n+q), G (m, n+q), Z (q, n+q), X (n, n+q), H (q, n+q) of eq:s_stack, eq:Z_def, eq:F_def, eq:G_def, eq:Fc_def.
    lower, upper (q,): D0 and D1, bounds on eta_i / z_i; units: the hidden unit that each row of Z and H belongs to.
    about: what s is the deviation from. "origin": nothing, s is the state itself, and D0, D1 are the sectors (Assumption
    ass:sector). "difference": another motion, and D0, D1 are the slope ranges (Assumption ass:incremental_sector); so it
    is where biases move the equilibrium. "rest": the equilibrium that `exact_rest.rest_point` states, where the
    pre-activations are `center`, (q,) Fractions; slope ranges too.

    A loop may be widened: `with_inputs` appends columns that enter from outside (`inputs` in number, after x and eta),
    `lifting.unrolled` those of later hidden vectors, multipliers columns of their own (`atoms`: the unit of each,
    `parts`: what they stand for). Then X and F are the rows that a Lyapunov function is quadratic in, now and one step
    on; X[:n] is x in every case.
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
    units: tuple[int, ...]
    about: str
    atoms: tuple[int, ...] = ()
    center: Any = None
    inputs: int = 0
    parts: Any = None

    @property
    def n(self) -> int:
        """Number of states."""
        return self.plant.n

    @property
    def q(self) -> int:
        """Number of hidden units."""
        return self.inc.q

    @property
    def width(self) -> int:
        """Length of s."""
        return self.X.shape[1]

    def read(self, kind: Any) -> ClosedLoop:
        """Return a loop that is not widened with its matrices formed anew from the stored floats, in another arithmetic.

        kind: a `readings.Reading`, such as `Rational`.
        """
        plant, inc = self.plant, self.inc
        parts = [kind.lift(part) for part in (plant.A, plant.B, plant.C, inc.W, inc.U, inc.V, inc.K)]
        F, G, Z, X, H = stacked_matrices(*parts)
        return replace(self, F=F, G=G, Z=Z, X=kind.lift(X), H=kind.lift(H), lower=kind.lift(self.lower),
                       upper=kind.lift(self.upper))

    def with_inputs(self, E: Array, D: Array | None = None) -> ClosedLoop:
        """Return the loop with w appended to s: x+ = A x + B u + E w and y = C x + D w; E (n, r), D (p, r) or None.

        >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC.linear([[2.0]]))
        >>> loop.with_inputs(np.array([[1.0]]), np.array([[3.0]])).F.tolist()
        [[2.5, 7.0]]
        """
        r = E.shape[1]
        D = np.zeros((self.plant.p, r)) if D is None else D
        noise, entry = _lifted(self.F, D), _lifted(self.F, E)
        K, U, B = (_lifted(self.F, part) for part in (self.inc.K, self.inc.U, self.plant.B))
        return replace(self, F=hstack(self.F, entry + B @ K @ noise), G=hstack(self.G, K @ noise),
                       Z=hstack(self.Z, U @ noise), X=self.padded(self.X, r), H=self.padded(self.H, r),
                       inputs=self.inputs + r)

    @staticmethod
    def padded(rows: Any, columns: int) -> Any:
        """Return rows over s as rows over s with that many further columns."""
        return hstack(rows, np.zeros((rows.shape[0], columns)))


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


def fitting(plant: Any, controller: Any, name: str = "the controller") -> Plant:
    """Return the plant, converted if it is a control.StateSpace, whose p and m are those of a controller of any kind.

    Raises DimensionError when they are not; name: of the controller in the message.

    >>> fitting(Plant([[1.5]], [[1.0]]), INC.linear([[-1.0]])).n
    1
    """
    plant = as_plant(plant)
    if (controller.p, controller.m) != (plant.p, plant.m):
        raise DimensionError(f"{name} maps {controller.p} measurements to {controller.m} inputs, but the plant has "
                             f"{plant.p} measurements and {plant.m} inputs")
    return plant


def close_loop(plant: Plant, inc: INC) -> ClosedLoop:
    """Return the loop of a plant and a controller.

    plant: a Plant or a control.StateSpace. Raises DimensionError when the sizes do not fit.

    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0))
    >>> loop.F.tolist(), loop.Z.tolist()
    ([[1.5, 1.0]], [[-1.5, 0.0]])
    """
    plant = fitting(plant, inc)
    F, G, Z, X, H = stacked_matrices(plant.A, plant.B, plant.C, inc.W, inc.U, inc.V, inc.K)
    if inc.preserves_origin:
        ends = sectors(inc.activations)
        assert ends is not None
    else:
        ends = slopes(inc.activations)
    about = "origin" if inc.preserves_origin else "difference"
    return ClosedLoop(plant, inc, F, G, Z, X, H, *ends, tuple(range(inc.q)), about)


def _lifted(like: Any, value: Array) -> Any:
    """Return an array as the kind of a Reading, or as it is where the loop holds floats."""
    return like.lift(value) if isinstance(like, Reading) else value


@dataclass(frozen=True, eq=False)
class Equilibrium(Brief):
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
