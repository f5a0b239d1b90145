"""The stages of the lifted training problem: the loop's equations at one time in one scenario, kinks rounded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.graph import units_graph

from .ipopt import ca
from .objective import Layout
from .rollout import Motion, Parameters, Scenario
from .stagewise import Copies, Spread, Stage, Stagewise


@dataclass(frozen=True, eq=False)
class Lifted:
    """The lifted form of a scenario over a layout.

    Variables: those of the layout; W itself, where it is trained; d and z_0, the preactivation at y = 0, when the law is
    anchored; then, scenario by scenario and stage by stage, z_k (q,), v_k (m,) and x_{k+1} (n,). With eta = phi(z) written
    out, the constraints are

        W eta_k + U C x_k + b = z_k,   K C x_k + V eta_k + d = v_k,   A x_k + B u_k = x_{k+1},

    H u_k <= h, G x_{k+1} <= g, and the same without x for z_0: W eta_0 + b = z_0, V eta_0 + d = 0. W = W+ - W- with
    W+, W- >= 0 and row sums of W+ + W- at most kappa: this is -S <= W <= S, S 1 <= kappa with S = W+ + W-. W is a variable
    of its own so that what is dense in the equations of a step has the size of W, not of W+ and W- together. Where
    `readout`, u_k = clip(v_k), and else u_k = v_k, bounded. Piecewise-affine phi and the clip are rounded over a width
    `smoothing` (in units of z, and of half the input range); smooth phi is exact. Everything is linear in the law.

    scale: of the cost; states: (G, g) or None.
    """

    scenario: Scenario
    layout: Layout
    scale: float
    readout: bool
    states: tuple[Array, Array] | None

    @property
    def entries(self) -> int:
        """Number of entries of W that are variables: q^2, or none."""
        return self.layout.rows.shape[0] ** 2

    @property
    def head(self) -> int:
        """Number of variables before those of the stages."""
        anchor = self.scenario.B.shape[1] + self.scenario.q if self.scenario.anchored else 0
        return self.layout.size + self.entries + anchor

    @property
    def body(self) -> np.ndarray:
        """The variables of each stage, (S, q + m + n)."""
        width = self.scenario.q + sum(self.scenario.B.shape)
        many = self.scenario.weights.size * self.scenario.steps
        return self.head + np.arange(many * width).reshape(many, width)

    def problem(self, smoothing: float) -> Stagewise:
        """Return the NLP with kinks rounded over this width."""
        scenario, layout = self.scenario, self.layout
        stages = self._stages(smoothing)
        size, m, P, after = self.head + self.body.size, scenario.B.shape[1], layout.fixed.size, layout.size + self.entries
        kept = np.r_[0:self.entries, 2 * self.entries:layout.size]  # W, which stands where W+ did, and all but W+ and W-
        row, factor, copies = layout.index[kept], layout.factor[kept], [stages]
        column = np.concatenate([layout.size + kept[:self.entries], kept[self.entries:]])
        fixed = layout.fixed.copy()
        if scenario.anchored:
            row, column = np.append(row, np.arange(P - m, P)), np.append(column, after + np.arange(m))
            factor, fixed[P - m:] = np.append(factor, np.ones(m)), 0.0
            z0 = np.arange(after + m, self.head)[:, None]
            still = anchor_stage(scenario, layout, smoothing)
            copies.append(Copies(still, z0, np.zeros(z0.shape), np.zeros((0, 1)), stages.rows.size))
        return Stagewise(size, Spread(fixed, row, column, factor), tuple(copies), self._linear(size))

    def _linear(self, size: int) -> ca.DM:
        """Return the rows of W - W+ + W- = 0 and of the row sums."""
        rows, columns = np.nonzero(self.layout.rows)
        i = np.arange(self.entries)
        one = np.ones(i.size)
        parts = [(i, i, -one), (i, self.entries + i, one), (i, self.layout.size + i, one),
                 (self.entries + rows, columns, self.layout.rows[rows, columns])]
        row, column, value = (np.concatenate(part) for part in zip(*parts, strict=True))
        shape = (self.entries + self.layout.rows.shape[0], size)
        return ca.DM.triplet(row.tolist(), column.tolist(), ca.DM(value), *shape)

    def bounds(self) -> dict[str, Array]:
        """Return the bounds of variables and constraints by `nlpsol`'s names."""
        scenario, layout = self.scenario, self.layout
        n, m = scenario.B.shape
        q, size = scenario.q, self.head + self.body.size
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        lower[:layout.size] = layout.lower
        if not self.readout:
            v = self.body[:, q:q + m]
            lower[v], upper[v] = scenario.lower, scenario.upper
        sides = np.concatenate([np.zeros(q + m + n), scenario.h, np.zeros(0) if self.states is None else self.states[1]])
        open_below = np.where(np.arange(sides.size) < q + m + n, 0.0, -np.inf)
        many, norms = len(self.body), layout.rows.shape[0]
        zero = np.zeros(self.entries + (q + m if scenario.anchored else 0))  # of the law at y = 0 and of the parts of W
        return {"lbx": lower, "ubx": upper,
                "lbg": np.concatenate([np.tile(open_below, many), zero, np.full(norms, -np.inf)]),
                "ubg": np.concatenate([np.tile(sides, many), zero, np.full(norms, layout.kappa)])}

    def point(self, x: Array, law: Parameters, motion: Motion) -> Array:
        """Return all variables for those of the layout, which stand for `law`, along a motion, perhaps of another law.

        At another law's motion, eta must be this law's at those states; v then need not be.
        """
        T = self.scenario.steps
        anchor = [-(law.V @ motion.origin_eta), law.W @ motion.origin_eta + law.b] if self.scenario.anchored else []
        z = motion.eta @ law.W.T + motion.x[:T] @ self.scenario.C.T @ law.U.T + law.b
        body = np.concatenate([z, motion.v, motion.x[1:]], axis=2)
        W = x[:self.entries] - x[self.entries:2 * self.entries]
        return np.concatenate([x, W, *anchor, np.swapaxes(body, 0, 1).ravel()])

    def _stages(self, smoothing: float) -> Copies:
        scenario, T = self.scenario, self.scenario.steps
        n, S = scenario.A.shape[0], len(self.body)
        k = np.arange(S) % T
        columns = np.vstack([self.body[:, :n].T - n, self.body.T])  # x_k is the end of the stage before
        columns[:n, k == 0] = -1
        values = np.zeros(columns.shape)
        values[:n, k == 0] = scenario.nodes
        weight = np.repeat(scenario.weights, T) / self.scale
        after = weight * scenario.discount ** (k + 1)
        data = np.vstack([weight * scenario.discount**k, np.where(k < T - 1, after, 0.0), np.where(k < T - 1, 0.0, after)])
        return Copies(self._stage(smoothing), columns, values, data, 0)

    def _stage(self, smoothing: float) -> Stage:
        scenario = self.scenario
        n, m = scenario.B.shape
        theta, data = ca.SX.sym("theta", self.layout.fixed.size), ca.SX.sym("data", 3)
        x, z, v, after = (ca.SX.sym(name, size) for name, size in (("x", n), ("z", scenario.q), ("v", m), ("after", n)))
        W, U, V, K, b, d = matrices(self.layout, theta)
        eta, y = units_graph(scenario.units, z, smoothing), ca.DM(scenario.C) @ x
        u = rounded_clip(v, scenario.lower, scenario.upper, smoothing) if self.readout else v
        residuals = [W @ eta + U @ y + b - z, K @ y + V @ eta + d - v, ca.DM(scenario.A) @ x + ca.DM(scenario.B) @ u - after]
        if scenario.h.size:
            residuals.append(ca.DM(scenario.H) @ u)
        if self.states is not None:
            residuals.append(ca.DM(self.states[0]) @ after)
        cost = (data[0] * quadratic(scenario.R, u) + data[1] * quadratic(scenario.Q, after)
                + data[2] * quadratic(scenario.terminal, after))
        return Stage(theta, ca.vertcat(x, z, v, after), data, cost, ca.vertcat(*residuals))


def anchor_stage(scenario: Scenario, layout: Layout, smoothing: float) -> Stage:
    """Return the stage that keeps the law at its fixed point, and its output at 0, for y = 0."""
    theta, z = ca.SX.sym("theta", layout.fixed.size), ca.SX.sym("z", scenario.q)
    W, _, V, _, b, d = matrices(layout, theta)
    eta = units_graph(scenario.units, z, smoothing)
    return Stage(theta, z, ca.SX(0, 1), ca.SX(1, 1), ca.vertcat(W @ eta + b - z, V @ eta + d))


def matrices(layout: Layout, theta: ca.SX) -> list[ca.SX]:
    """Return W, U, V, K, b, d among the entries of a law, row by row in theta."""
    shapes = layout.shapes
    ends = np.cumsum([0] + [int(np.prod(shape)) for shape in shapes]).tolist()
    parts = [theta[low:high] for low, high in zip(ends[:-1], ends[1:], strict=True)]
    return [ca.reshape(part, shape[1], shape[0]).T if len(shape) == 2 else part
            for part, shape in zip(parts, shapes, strict=True)]


def quadratic(weight: Array, a: ca.SX) -> ca.SX:
    """Return a' weight a."""
    return ca.dot(a, ca.DM(weight) @ a)


def rounded_clip(v: ca.SX, lower: Array, upper: Array, smoothing: float) -> ca.SX:
    """Return clip(v) with its kinks rounded over `smoothing` half ranges; it stays strictly within the limits.

    >>> limits = np.array([-1.0, -np.inf]), np.array([1.0, np.inf])
    >>> rounded_clip(ca.DM([9.0, 9.0]), *limits, 0.1).full().round(3).ravel().tolist()
    [1.0, 9.0]
    """
    both = np.isfinite(upper - lower)
    width = smoothing * np.where(both, (upper - lower) / 2, 1.0)

    def ramp(r: ca.SX, eps: float) -> ca.SX:
        return (r + ca.sqrt(r**2 + eps**2)) / 2

    rows: list[ca.SX] = []
    for j, (low, high, eps) in enumerate(zip(lower.tolist(), upper.tolist(), width.tolist(), strict=True)):
        out: ca.SX = v[j]
        if np.isfinite(low):
            out = low + ramp(out - low, eps)
        if np.isfinite(high):
            out = out - ramp(v[j] - high, eps) if np.isfinite(low) else high - ramp(high - out, eps)
        rows.append(out)
    return ca.vertcat(*rows)

