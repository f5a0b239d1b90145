"""The training problem of a continuous loop by collocation: states and preactivations at Radau points, kinks rounded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.graph import units_graph

from .flow import Path
from .ipopt import ca
from .lifted_stages import anchor_stage, matrices, quadratic, rounded_clip
from .objective import Layout
from .rollout import Parameters, Scenario
from .stagewise import Copies, Spread, Stage, Stagewise


@dataclass(frozen=True, eq=False)
class Points:
    """Radau's points of one interval: c (s,) with c_s = 1; derivative (s+1, s); weights (s,).

    A polynomial through x_0 at 0 and x_j at c_j has the derivatives [x_0, ..., x_s] @ derivative at the points, and the
    integral of f over the interval is close to sum_j weights_j f(c_j). The method is Radau IIA: order 2 s - 1 for states and
    integrals alike, and stiff modes do not disturb it (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.5).

    >>> radau(2).c.round(6).tolist(), radau(2).weights.round(6).tolist()
    ([0.333333, 1.0], [0.75, 0.25])
    """

    c: Array
    derivative: Array
    weights: Array


def radau(degree: int) -> Points:
    """Return the points of a degree from 1 to 9."""
    points = ca.collocation_points(degree, "radau")
    c, powers = np.array(points), np.arange(degree)
    # CasADi's own weights count 0 as a point too, which for one point makes the trapezoidal rule of Euler's method.
    weights = np.linalg.solve(c ** powers[:, None], 1.0 / (powers + 1))
    return Points(c, ca.collocation_coeff(points)[0].full(), weights)


@dataclass(frozen=True, eq=False)
class Collocated:
    """The collocated form of a scenario over a layout: what `Lifted` is for steps, for intervals of length `step`.

    Variables: those of the layout; d and z_0, the preactivation at y = 0, when the law is anchored; then, scenario by
    scenario, interval by interval and point by point, z_j (q,), v_j (m,), x_j (n,); the last point is the next interval's
    x_0. With eta = phi(z) written out the constraints at every point are

        W eta_j + U C x_j + b = z_j,   K C x_j + V eta_j + d = v_j,   h (A x_j + B u_j) = sum_i x_i derivative_ij,

    and the cost is sum h weights_j exp(-gamma t_j) (x_j'Q x_j + u_j'R u_j) with the terminal cost at the end. u = clip(v),
    the bound on the rows of W and the rounding of kinks over `smoothing` are as in `Lifted`. All of it is linear in the law,
    so `Stagewise` differentiates one interval and assembles the rest.

    scenario: A, B, Q, R and discount per second, `steps` counts intervals; scale: of the cost; step: h in seconds.
    """

    scenario: Scenario
    layout: Layout
    scale: float
    step: float
    points: Points

    @property
    def head(self) -> int:
        """Number of variables before those of the intervals."""
        return self.layout.size + (self.scenario.B.shape[1] + self.scenario.q if self.scenario.anchored else 0)

    @property
    def width(self) -> int:
        """Number of variables of one point: q + m + n."""
        return self.scenario.q + sum(self.scenario.B.shape)

    @cached_property
    def body(self) -> np.ndarray:
        """The variables of each interval, (S, s (q + m + n))."""
        many, width = self.scenario.weights.size * self.scenario.steps, self.points.c.size * self.width
        return self.head + np.arange(many * width).reshape(many, width)

    def problem(self, smoothing: float) -> Stagewise:
        """Return the NLP with kinks rounded over this width."""
        scenario, layout = self.scenario, self.layout
        intervals = self._intervals(smoothing)
        size, m, P = self.head + self.body.size, scenario.B.shape[1], layout.fixed.size
        row, column, factor, copies = layout.index, np.arange(layout.size), layout.factor, [intervals]
        fixed = layout.fixed.copy()
        if scenario.anchored:
            row, column = np.append(row, np.arange(P - m, P)), np.append(column, layout.size + np.arange(m))
            factor, fixed[P - m:] = np.append(factor, np.ones(m)), 0.0
            z0 = np.arange(layout.size + m, self.head)[:, None]
            still = anchor_stage(scenario, layout, smoothing)
            copies.append(Copies(still, z0, np.zeros(z0.shape), np.zeros((0, 1)), intervals.rows.size))
        rows, columns = np.nonzero(layout.rows)
        norms = ca.DM.triplet(rows.tolist(), columns.tolist(), ca.DM(layout.rows[rows, columns]), layout.rows.shape[0], size)
        return Stagewise(size, Spread(fixed, row, column, factor), tuple(copies), norms)

    def bounds(self) -> dict[str, Array]:
        """Return the bounds of variables and constraints by `nlpsol`'s names."""
        layout, size = self.layout, self.head + self.body.size
        lower = np.full(size, -np.inf)
        lower[:layout.size] = layout.lower
        anchor = self.scenario.B.shape[1] + self.scenario.q if self.scenario.anchored else 0
        equations, norms = np.zeros(self.body.size + anchor), layout.rows.shape[0]
        return {"lbx": lower, "ubx": np.full(size, np.inf),
                "lbg": np.concatenate([equations, np.full(norms, -np.inf)]),
                "ubg": np.concatenate([equations, np.full(norms, layout.kappa)])}

    def point(self, x: Array, law: Parameters, path: Path, origin: Array) -> Array:
        """Return all variables for those of the layout, which stand for `law`, along a path; origin: its eta at y = 0.

        The path's eta must be this law's at the path's states; its v need not be.
        """
        anchor = [-(law.V @ origin), law.W @ origin + law.b] if self.scenario.anchored else []
        z = path.eta @ law.W.T + path.x @ self.scenario.C.T @ law.U.T + law.b
        body = np.concatenate([z, path.v, path.x], axis=3)
        return np.concatenate([x, *anchor, np.moveaxis(body, 2, 0).ravel()])

    def states(self, variables: Array) -> Array:
        """Return the states among all variables, (T, s, N, n)."""
        scenario = self.scenario
        body = variables[self.head:].reshape(scenario.weights.size, scenario.steps, self.points.c.size, self.width)
        return np.moveaxis(body[..., -scenario.A.shape[0]:], 0, 2)

    def _intervals(self, smoothing: float) -> Copies:
        scenario, T = self.scenario, self.scenario.steps
        n, k = scenario.A.shape[0], np.arange(len(self.body)) % T
        columns = np.vstack([self.body[:, :n].T - n, self.body.T])  # x_0 is the last point of the interval before
        columns[:n, k == 0] = -1
        values = np.zeros(columns.shape)
        values[:n, k == 0] = scenario.nodes
        weight = np.repeat(scenario.weights, T) / self.scale
        last = weight * scenario.discount ** (T * self.step)
        data = np.vstack([weight * scenario.discount ** (k * self.step), np.where(k < T - 1, 0.0, last)])
        return Copies(self._interval(smoothing), columns, values, data, 0)

    def _interval(self, smoothing: float) -> Stage:
        scenario, points = self.scenario, self.points
        n, m = scenario.B.shape
        theta, data, start = ca.SX.sym("theta", self.layout.fixed.size), ca.SX.sym("data", 2), ca.SX.sym("start", n)
        W, U, V, K, b, d = matrices(self.layout, theta)
        z, v, x = ([ca.SX.sym(f"{name}{j}", size) for j in range(points.c.size)]
                   for name, size in (("z", scenario.q), ("v", m), ("x", n)))
        moved = ca.horzcat(start, *x) @ ca.DM(points.derivative)
        residuals, cost = [], data[1] * quadratic(scenario.terminal, x[-1])
        for j, share in enumerate(self.step * points.weights * scenario.discount ** (self.step * points.c)):
            eta, y = units_graph(scenario.units, z[j], smoothing), ca.DM(scenario.C) @ x[j]
            u = rounded_clip(v[j], scenario.lower, scenario.upper, smoothing)
            flow = self.step * (ca.DM(scenario.A) @ x[j] + ca.DM(scenario.B) @ u)
            residuals += [W @ eta + U @ y + b - z[j], K @ y + V @ eta + d - v[j], flow - moved[:, j]]
            cost += data[0] * share * (quadratic(scenario.Q, x[j]) + quadratic(scenario.R, u))
        s = ca.vertcat(start, *[part for point in zip(z, v, x, strict=True) for part in point])
        return Stage(theta, s, data, cost, ca.vertcat(*residuals))
