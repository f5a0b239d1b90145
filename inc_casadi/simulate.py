"""Roll the closed loop out: exact steps in discrete time, SciPy's integrator in continuous time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, columns, number, symmetric
from .brief import Brief
from .errors import ConvergenceError, InvalidInputError
from .inc import INC
from .loop import close_loop
from .plant import Plant, as_plant


@dataclass(frozen=True, eq=False)
class Trajectory(Brief):
    """Closed-loop motions: t (T+1,), x (n, T+1), u (m, T+1), eta (q, T+1); from N starting points (n, N, T+1) and so on.

    u and eta are those the controller answers at each listed instant.
    """

    t: Array
    x: Array
    u: Array
    eta: Array
    discrete: bool

    def cost(self, Q: ArrayLike, R: ArrayLike, discount: float = 1.0) -> Array:
        """Return sum_k discount^k (x_k' Q x_k + u_k' R u_k) over the listed steps: a number, or (N,).

        Discrete trajectories only. Q: (n, n) per squared state unit; R: (m, m) per squared input unit.

        >>> from inc_casadi import Plant, INC
        >>> run = simulate(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), [1.0], steps=2)
        >>> float(run.cost([[1.0]], [[0.0]]))
        1.3125
        """
        if not self.discrete:
            raise InvalidInputError("the discounted cost is a sum over steps: sample the plant first, plant.sampled(dt)")
        Q = symmetric("Q", Q, self.x.shape[0])
        R = symmetric("R", R, self.u.shape[0])
        stage = quadratic(Q, self.x) + quadratic(R, self.u)
        return stage @ number("discount", discount, 0.0, 1.0, open_low=True) ** np.arange(self.t.size)


def simulate(plant: Plant, inc: INC, x0: ArrayLike, *, steps: int = 100, duration: float | None = None,
             times: ArrayLike | None = None) -> Trajectory:
    """Return the closed-loop motion from x0.

    x0: (n,) or columns (n, N). Discrete plants take `steps` steps of length dt. Continuous plants run over `duration`
    (in the plant's time unit) or are listed at increasing `times` that begin at 0.

    Raises InvalidInputError when the arguments do not fit the plant's time, ConvergenceError when the integrator fails.

    >>> from inc_casadi import Plant, INC
    >>> simulate(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), [1.0], steps=2).x.tolist()
    [[1.0, 0.5, 0.0]]
    """
    plant = as_plant(plant)
    close_loop(plant, inc)
    start, single = columns("x0", x0, plant.n)
    if plant.discrete:
        if duration is not None or times is not None:
            raise InvalidInputError("duration and times belong to continuous plants: a discrete plant takes steps")
        if steps < 0:
            raise InvalidInputError(f"steps = {steps} is negative")
        t, x = _discrete(plant, inc, start, steps)
    else:
        t, x = _continuous(plant, inc, start, _instants(duration, times))
    flat = x.reshape(plant.n, -1)
    eta = inc.solve(plant.C @ flat).eta
    u = inc.K @ plant.C @ flat + inc.V @ eta + inc.d[:, None]
    shape = x.shape[1:]
    u, eta = u.reshape(plant.m, *shape), eta.reshape(inc.q, *shape)
    if single:
        x, u, eta = x[:, 0], u[:, 0], eta[:, 0]
    return Trajectory(t, x, u, eta, plant.discrete)


def _discrete(plant: Plant, inc: INC, x: Array, steps: int) -> tuple[Array, Array]:
    states = [x]
    for _ in range(steps):
        x = plant.A @ x + plant.B @ inc(plant.C @ x)
        states.append(x)
    return plant.dt * np.arange(steps + 1), np.stack(states, axis=-1)


def _instants(duration: float | None, times: ArrayLike | None) -> Array:
    if times is not None:
        instants = np.asarray(times, dtype=float)
        if instants.ndim != 1 or instants.size < 2 or instants[0] != 0 or np.any(np.diff(instants) <= 0):
            raise InvalidInputError("times must begin at 0 and increase")
        return instants
    if duration is None:
        raise InvalidInputError("a continuous plant needs a duration or times")
    return np.linspace(0.0, number("duration", duration, 0.0, open_low=True), 201)


def _continuous(plant: Plant, inc: INC, start: Array, instants: Array) -> tuple[Array, Array]:
    from scipy.integrate import solve_ivp
    shape = start.shape

    def velocity(_: float, flat: Array) -> Array:
        x = flat.reshape(shape)
        return (plant.A @ x + plant.B @ inc(plant.C @ x)).ravel()

    run = solve_ivp(velocity, (0.0, instants[-1]), start.ravel(), t_eval=instants, rtol=1e-9, atol=1e-12)
    if not run.success:
        raise ConvergenceError(f"the integrator stopped at t = {run.t[-1] if run.t.size else 0:g}: {run.message}")
    return instants, run.y.reshape(*shape, -1)


def quadratic(weight: Array, points: Array) -> Array:
    """Return x' weight x for each column x of points (n, ...).

    >>> quadratic(np.diag([1.0, 2.0]), np.array([[1.0, 0.0], [1.0, 3.0]])).tolist()
    [3.0, 18.0]
    """
    return np.sum(points * np.tensordot(weight, points, axes=1), axis=0)
