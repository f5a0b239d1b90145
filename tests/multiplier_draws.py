"""Activations with several kinks, points on graphs at kinks and elsewhere, and random values that a multiplier may take.

The columns of s that a multiplier adds for further kinks are computed here once more, from clamped lengths alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import oracles

from inc_casadi import INC, Plant
from inc_casadi.activations import Activation, Pieces


@dataclass(frozen=True)
class Bent(Activation):
    """A continuous piecewise-affine unit through the origin, from kinks and slopes."""

    at: tuple[float, ...]
    steepness: tuple[float, ...]

    @property
    def pieces(self):
        intercepts = [0.0]
        for j, kink in enumerate(self.at):
            intercepts.append(intercepts[-1] + (self.steepness[j] - self.steepness[j + 1]) * kink)
        home = sum(kink < 0 for kink in self.at)
        return Pieces(np.array(self.at), np.array(self.steepness), np.array(intercepts) - intercepts[home])

    def formula(self, z, ops):
        p = self.pieces
        out = p.slopes[0] * z + p.intercepts[0]
        for kink, before, after in zip(p.kinks, p.slopes, p.slopes[1:], strict=False):
            out = out + (after - before) * ops.fmax(z - kink, 0.0)
        return out

    def derivative(self, z):
        return self._slope_of_piece(z)

    @property
    def slopes(self):
        return (min(self.steepness), max(self.steepness))


DEAD_ZONE = Bent((-0.5, 1.0), (1.0, 0.0, 1.0))
THREE = Bent((-1.0, 0.25, 2.0), (0.5, -0.25, 1.0, 0.125))
CONCAVE = Bent((0.0,), (1.0, 0.25))


@dataclass(frozen=True)
class Lopsided(Activation):
    """log((1 + e^z) / 2): curved, not odd, of slope in [0, 1], zero at zero."""

    def formula(self, z, ops):
        return ops.fmax(z, 0.0) + ops.log((1.0 + ops.exp(-ops.fabs(z))) / 2.0)  # no overflow

    def derivative(self, z):
        return (1.0 + np.tanh(np.asarray(z, dtype=float) / 2)) / 2

    @property
    def slopes(self):
        return (0.0, 1.0)


def square_loop(rng, units, *, dyadic=False, rest=None, n_extra=1, dt=1.0):
    """A plant and a controller whose pre-activations can be anything: as many measurements as units, U and C of full rank.

    dyadic: W = 0, U = I, C = [I 0] and numbers with few digits, so that levels are reached without rounding; rest (q,): the
    level of every unit at the equilibrium, reached by biases. n = q + n_extra states, 2 inputs.
    """
    q, n = len(units), len(units) + n_extra
    if dyadic:
        A = np.triu(rng.integers(-2, 3, size=(n, n)) / 8, 1) + np.diag(rng.choice([0.0, 0.5], size=n))
        B, C = rng.integers(-2, 3, size=(n, 2)) / 4, np.eye(q, n)
        W, U = np.triu(rng.integers(-2, 3, size=(q, q)) / 8, 1), np.eye(q)
        V, K = rng.integers(-2, 3, size=(2, q)) / 8, rng.integers(-2, 3, size=(2, q)) / 8
    else:
        A, B, C = 0.4 * rng.normal(size=(n, n)) / np.sqrt(n), rng.normal(size=(n, 2)), rng.normal(size=(q, n))
        W, U = 0.5 * rng.normal(size=(q, q)) / max(q, 1), rng.normal(size=(q, q)) + 2 * np.eye(q)
        V, K = 0.1 * rng.normal(size=(2, q)), 0.02 * rng.normal(size=(2, q))
    b = d = None
    if rest is not None:
        # u* is free: x* = (I - A)^-1 B u* follows, then b and d from z* and u*.
        u, eta = rng.integers(-4, 5, size=2) / 4, values_of(units, np.array(rest)[:, None])[:, 0]
        x = np.linalg.solve(np.eye(n) - A, B @ u)
        b, d = np.array(rest) - W @ eta - U @ (C @ x), u - K @ (C @ x) - V @ eta
    return Plant(A, B, C, dt), INC(W, U, V, K, b, d, units)


def values_of(units, z):
    """phi(z) for levels z (q, N)."""
    return np.array([oracles.phi(unit, z[i]) for i, unit in enumerate(units)]).reshape(z.shape)


def states_at(plant, inc, z, rng):
    """States (n, N) at which the units of a `square_loop` have the levels z (q, N)."""
    y = np.linalg.solve(inc.U, z - inc.W @ values_of(inc.activations, z) - inc.b[:, None])
    across = np.linalg.svd(plant.C)[2][plant.p :]
    return np.linalg.pinv(plant.C) @ y + across.T @ rng.normal(size=(len(across), z.shape[1]))


def levels(units, rng, N):
    """Levels (q, N): random ones of several sizes, with about half of the entries moved onto or very near kinks and zero."""
    z = rng.normal(size=(len(units), N)) * 10.0 ** rng.uniform(-1, 1.3, size=(1, N))
    for i, unit in enumerate(units):
        kinks = np.array([0.0, *(() if unit.pieces is None else unit.pieces.kinks)])
        near = rng.choice(kinks, size=N) + rng.choice([0.0, 0.0, -1e-9, 1e-9], size=N)
        z[i] = np.where(rng.random(N) < 0.4, near, z[i])
    return z


def lengths(unit, z):
    """The lengths a_1, ..., a_{r-1}, p of z past each kink where the slope changes, for z (N,), and their slopes."""
    p = unit.pieces
    kept = [j for j in range(len(p.kinks)) if p.slopes[j] != p.slopes[j + 1]]
    kinks = [*p.kinks[kept], np.inf]
    return np.array([np.clip(z - low, 0.0, high - low) for low, high in zip(kinks, kinks[1:], strict=False)]), p.slopes[
        [0, *(j + 1 for j in kept)]
    ]


def further_columns(unit, z):
    """The lengths that a unit adds to s: all but the one whose slope differs most from the leftmost slope."""
    if unit.pieces is None or len(unit.pieces.kinks) == 0:
        return np.zeros((0, len(z)))
    parts, slopes = lengths(unit, z)
    if len(parts) == 0:
        return np.zeros((0, len(z)))
    return np.delete(parts, int(np.argmax(np.abs(slopes[1:] - slopes[0]))), axis=0)


def stack(plant, inc, x, *, steps=0, columns=False, rest=None):
    """The vector s = (x, eta_0, ..., eta_steps, further columns) (width, N) along motions from x (n, N), less its rest.

    columns: whether the columns of kinks are in s; rest: x* (n,) or None for the origin.
    """
    if rest is not None:
        moved = stack(plant, inc, np.array(rest, dtype=float)[:, None], steps=steps, columns=columns)
        return stack(plant, inc, x, steps=steps, columns=columns) - moved
    etas, further, state = [], [], x
    for _ in range(steps + 1):
        eta = oracles.hidden(inc, plant.C @ state)
        z = inc.W @ eta + inc.U @ plant.C @ state + inc.b[:, None]
        etas.append(eta)
        further += [further_columns(unit, z[i]) for i, unit in enumerate(inc.activations)] if columns else []
        state = plant.A @ state + plant.B @ (inc.K @ plant.C @ state + inc.V @ eta + inc.d[:, None])
    return np.vstack([x, *etas, *further])


def drawn_values(rng, multiplier, loop, *, tight=False):
    """Random values on the sign conditions: signed entries >= 0, and r and w as small as `signs` allows, or larger.

    About a third of the entries that may vanish do.
    """
    values = {}
    for unknown in multiplier.unknowns(loop):
        value = rng.normal(size=unknown.shape) * (rng.random(unknown.shape) < 0.7)
        value = np.where(unknown.signed, np.abs(value), value) * unknown.free
        values[unknown.name] = (value + value.T) / 2 if unknown.is_symmetric else value
    return paid(rng, multiplier, loop, values, tight=tight)


def paid(rng, multiplier, loop, values, *, tight=True):
    """The values with r and w the least that `signs` allows, or larger by random amounts."""
    for name in {"r", "w"} & set(values):
        unknown = next(u for u in multiplier.unknowns(loop) if u.name == name)
        zeros = {key: np.zeros_like(value) for key, value in values.items()}
        slope = multiplier.signs(loop, {**zeros, name: np.ones(unknown.shape) * unknown.free})
        base = multiplier.signs(loop, {**values, name: np.zeros(unknown.shape)})
        needs = [-base[key][:, 0] / slope[key][:, 0] for key in slope if np.all(slope[key] != 0)]
        value = np.zeros(unknown.shape)
        more = np.zeros(unknown.free.sum()) if tight else rng.exponential(size=unknown.free.sum())
        value[unknown.free] = np.max([*needs, np.full(len(more), -np.inf if needs else 0.0)], axis=0) + more
        values = {**values, name: np.maximum(value, 0.0) if name == "r" else value}
    return values


def smallest_value(M, s):
    """The smallest s'M s over columns, each relative to the size of its terms and of what rounding leaves in tiny ones."""
    size = np.einsum("in,ij,jn->n", np.abs(s), np.abs(M), np.abs(s)) + 1e-6 * np.abs(M).max() * np.abs(s).max(axis=0)
    return float(np.min(oracles.quadratic(M, s) / np.maximum(size, 1e-300)))
