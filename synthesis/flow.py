"""The true motion of a continuous loop from many states at once: on a fixed grid, and by an adaptive integrator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from inc_casadi.arrays import Array

from .dormand_prince import integrate
from .rollout import Parameters, Scenario, hidden

Control = Callable[[Array, Array], tuple[Array, Array]]
"""From states (N, n) and hidden units nearby (N, q) to inputs before clipping (N, m) and hidden units (N, q)."""

RTOL, ATOL = 1e-8, 1e-10  # of the adaptive integrator; ATOL in units of the initial states and of their cost
_SUBSTEPS = 2  # steps of the Runge-Kutta method between two listed points
_SETTLED, _STRETCHES = 1e-8, 16  # the share of the cost that may be left to the terminal cost; most horizons followed
_LOST = 1e6  # times the largest initial state: a motion that far out is lost


@dataclass(frozen=True, eq=False)
class Path:
    """Motions at the points of a grid: x (T, s, N, n), v (T, s, N, m), eta (T, s, N, q), and the cost of all together.

    Interval k of length h has points (k + c_j) h, j < s; the initial states are not listed. cost: the weighted mean of the
    integral over the grid, and the terminal cost at its end.
    """

    x: Array
    v: Array
    eta: Array
    cost: float


def law_control(scenario: Scenario, law: Parameters) -> Control:
    """Return the control of a law, with d = -V eta(y = 0) when the scenario is anchored."""
    origin, _ = hidden(scenario, law.W, law.b[None], np.zeros((1, scenario.q)))
    offset = -(origin[0] @ law.V.T) if scenario.anchored else law.d

    def control(x: Array, near: Array) -> tuple[Array, Array]:
        y = x @ scenario.C.T
        eta, _ = hidden(scenario, law.W, y @ law.U.T + law.b, near)
        return y @ law.K.T + eta @ law.V.T + offset, eta
    return control


def gain_control(scenario: Scenario, law: Parameters, gain: Array) -> Control:
    """Return u = gain x, beside the hidden units that a law has at x."""
    own = law_control(scenario, law)

    def control(x: Array, near: Array) -> tuple[Array, Array]:
        return np.clip(x @ gain.T, scenario.lower, scenario.upper), own(x, near)[1]
    return control


def follow(scenario: Scenario, control: Control, step: float, points: Array) -> Path:
    """Return the motion on the grid of a scenario, by the classical Runge-Kutta method between neighbouring points.

    Parameters
    ----------
    scenario : A and B per second, Q and R per second, discount per second; `steps` counts intervals
    control : the law, not rounded; its v is clipped to the limits
    step : length h of an interval in seconds
    points : (s,) increasing in (0, 1], the last of them 1

    Notes
    -----
    Of order four between kinks, and less precise across them: it watches a search, and `true_cost` judges.
    """
    T, N, gamma = scenario.steps, scenario.weights.size, -np.log(scenario.discount)
    x, eta = scenario.nodes.T, np.zeros((N, scenario.q))
    pieces = np.diff(points, prepend=0.0) * step / _SUBSTEPS
    xs, vs, etas, total = [], [], [], 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(T):
            for j, h in enumerate(pieces):
                t = (k + points[j]) * step - _SUBSTEPS * h
                for i in range(_SUBSTEPS):
                    x, eta, paid = _runge_kutta(scenario, control, x, eta, h)
                    total += paid * np.exp(-gamma * (t + (i + 0.5) * h))
                v, eta = control(x, eta)
                xs.append(x)
                vs.append(v)
                etas.append(eta)
        last = np.einsum("ni,ni->n", x @ scenario.terminal, x)
        total += np.exp(-gamma * T * step) * (last @ scenario.weights)
    grid = (T, points.size, N)
    listed = [np.reshape(rows, (*grid, rows[0].shape[1])) for rows in (xs, vs, etas)]
    return Path(listed[0], listed[1], listed[2], float(total) if np.isfinite(total) else np.inf)


def _runge_kutta(scenario: Scenario, control: Control, x: Array, eta: Array, h: float) -> tuple[Array, Array, float]:
    """Return the state a step on, hidden units near it, and the cost of the step, discounted to its middle."""
    decay = np.exp(np.log(scenario.discount) * h / 2)
    slopes, paid, ahead = [], [], x
    for share, weight in ((0.5, 1.0 / decay), (0.5, 1.0), (1.0, 1.0), (0.0, decay)):
        v, eta = control(ahead, eta)
        u = np.clip(v, scenario.lower, scenario.upper)
        slopes.append(ahead @ scenario.A.T + u @ scenario.B.T)
        paid.append(weight * float(_rate(scenario, ahead, u) @ scenario.weights))
        ahead = x + share * h * slopes[-1]
    a, b, c, d = slopes
    return x + h / 6 * (a + 2 * b + 2 * c + d), eta, h / 6 * (paid[0] + 2 * paid[1] + 2 * paid[2] + paid[3])


def _rate(scenario: Scenario, x: Array, u: Array) -> Array:
    return np.einsum("ni,ni->n", x @ scenario.Q, x) + np.einsum("ni,ni->n", u @ scenario.R, u)


def true_cost(scenario: Scenario, law: Parameters, stretch: float) -> float:
    """Return the cost of a law as it is, kinks and clipping included, by an integrator with a step for every node.

    The cost is one more state of every motion. All are followed from one stretch to the next until the terminal cost is
    below 1e-8 of the whole, which is then added, and for 16 stretches at most; infinite where a state leaves 1e6 times the
    initial ones, or a fixed point is lost.

    Parameters
    ----------
    scenario : as in `follow`; its `steps` is not used
    stretch : seconds
    """
    control, gamma = law_control(scenario, law), -np.log(scenario.discount)
    N, n = scenario.nodes.shape[::-1]
    size = max(float(np.max(np.abs(scenario.nodes))), 1e-300)
    scale = max(float(_rate(scenario, scenario.nodes.T, np.zeros((N, scenario.B.shape[1]))) @ scenario.weights), 1e-300)
    atol = ATOL * np.append(np.full(n, size), scale * stretch)
    near = np.zeros((N, scenario.q))

    def velocity(t: Array, state: Array, rows: np.ndarray) -> Array:
        x = state[:, :n]
        v, near[rows] = control(x, near[rows])
        u = np.clip(v, scenario.lower, scenario.upper)
        return np.column_stack([x @ scenario.A.T + u @ scenario.B.T, np.exp(-gamma * t) * _rate(scenario, x, u)])

    state, total = np.column_stack([scenario.nodes.T, np.zeros(N)]), np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(_STRETCHES):
            state = integrate(velocity, state, k * stretch, (k + 1) * stretch, RTOL, atol)
            if not np.max(np.abs(state[:, :n])) <= _LOST * size:
                return np.inf
            x = state[:, :n]
            last = np.exp(-gamma * (k + 1) * stretch) * np.einsum("ni,ni->n", x @ scenario.terminal, x) @ scenario.weights
            total = float(state[:, n] @ scenario.weights + last)
            if last <= _SETTLED * total:
                break
    return total
