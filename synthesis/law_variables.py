"""The controller's entries as variables of an NLP: W in two nonnegative parts, so that the bound on its rows is linear."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.inc import INC

from .condition_graph import ca
from .law_family import Family

SPARE = 2e-3  # of 1 - kappa, shared among W+ and W-: the barrier wants an interior


@dataclass
class Nlp:
    """Variables x with bounds and start, constraints g with bounds, parameters p; parts are appended in turn."""

    x: list[Any] = field(default_factory=list)
    g: list[Any] = field(default_factory=list)
    p: list[Any] = field(default_factory=list)
    low: list[Array] = field(default_factory=list)
    low_g: list[Array] = field(default_factory=list)
    high_g: list[Array] = field(default_factory=list)

    def variable(self, name: str, low: Array) -> Any:
        """Append variables with lower bounds (k,) and return their symbol."""
        self.x.append(ca.SX.sym(name, low.size))
        self.low.append(low)
        return self.x[-1]

    def constraint(self, expression: Any, low: float, high: Array | float) -> None:
        """Append low <= expression <= high."""
        size = expression.numel()
        self.g.append(ca.vec(expression))
        self.low_g.append(np.full(size, low))
        self.high_g.append(np.broadcast_to(high, (size,)))


def law_variables(nlp: Nlp, family: Family, theta0: Any) -> Any:
    """Append W+, W- >= 0 and the other free entries, in units of their scales, and the bound on the rows of W."""
    q = family.start.q
    W, rest = _split(family)
    plus, minus = nlp.variable("W+", np.zeros(W.size)), nlp.variable("W-", np.zeros(W.size))
    others = nlp.variable("UVK", np.full(rest.size, -np.inf))
    theta = ca.SX(theta0)
    if W.size:
        theta[W.tolist()] = ca.DM(family.scales[W]) * (plus - minus)
        for i in np.unique(W // q):
            row = np.flatnonzero(W // q == i)
            size = ca.dot(ca.DM(family.scales[W[row]] * family.weights[W[row] % q]), (plus + minus)[row.tolist()])
            nlp.constraint(size, -np.inf, _room(family)[i])
    if rest.size:
        theta[rest.tolist()] = ca.DM(family.scales[rest]) * others
    return theta


def _split(family: Family) -> tuple[Array, Array]:
    entries = family.start.W.size
    return np.flatnonzero(family.free[:entries]), entries + np.flatnonzero(family.free[entries:])


def _room(family: Family) -> Array:
    """Return kappa v_i / S_i less what the frozen entries of row i take, (q,)."""
    q = family.start.q
    held = np.where(family.free[: q * q].reshape(q, q), 0.0, np.abs(family.start.W))
    return family.kappa * family.weights / np.maximum(family.slope, 1e-300) - held @ family.weights


def law_start(family: Family, radius: float) -> tuple[Array, Array, Array]:
    """Return the variables of the start with their bounds; W+ and W- both get a little more than they need."""
    W, rest = _split(family)
    q, theta = max(family.start.q, 1), family.theta / family.scales
    spare = SPARE * (1.0 - family.kappa) / q
    plus, minus = np.maximum(theta[W], 0.0) + spare, np.maximum(-theta[W], 0.0) + spare
    x = np.concatenate([plus, minus, theta[rest]])
    low = x - radius
    low[: 2 * W.size] = np.maximum(low[: 2 * W.size], 0.0)
    return x, low, x + radius


def law_of(family: Family, x: Array) -> INC:
    """Return the law of the variables, rows of W that rounding left too large made smaller."""
    W, rest = _split(family)
    theta, q = family.theta.copy(), family.start.q
    theta[W] = family.scales[W] * (x[: W.size] - x[W.size: 2 * W.size])
    theta[rest] = family.scales[rest] * x[2 * W.size:]
    if W.size:
        free = np.where(family.free[: q * q].reshape(q, q), np.abs(theta[: q * q].reshape(q, q)), 0.0) @ family.weights
        shrink = np.minimum(1.0, (1.0 - 1e-12) * np.maximum(_room(family), 0.0) / np.maximum(free, 1e-300))
        theta[W] *= shrink[W // q]
    return family.inc(theta)
