"""The objective that training minimizes, as a function of one vector of variables, with its derivatives in NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from inc_casadi.arrays import Array

from .rollout import Motion, Parameters, Scenario, gradient, roll
from .sensitivities import gauss_newton

_DAMPING = (1e-5, 1.0)


@dataclass(frozen=True, eq=False)
class Layout:
    """How the NLP's variables x make up the matrices of the law: theta = fixed + sum of factor * x over `index`.

    W = W+ - W- with W+, W- >= 0, so that the row sums of W+ + W- bound ||W||_inf; the other matrices are scaled to the
    units of measurement and input. theta lists W, U, V, K, b, d, each row by row.

    shapes: of the six matrices; fixed (P,): the entries that are not trained; index, factor (nx,); rows (q or 0, nx):
    the row sums of W+ + W-, none when W is not trained; kappa: their bound.
    """

    shapes: tuple[tuple[int, ...], ...]
    fixed: Array
    index: np.ndarray
    factor: Array
    rows: Array
    kappa: float

    @classmethod
    def of(cls, law: Parameters, scales: Parameters, frozen: Sequence[str], kappa: float) -> Layout:
        """Return the layout that trains the matrices of `law` not named in `frozen`; scales: the unit of each entry."""
        trained = np.concatenate([np.full(part.size, name not in frozen) for name, part in law._asdict().items()])
        scale, theta, q, entries = flat(scales), flat(law), law.W.shape[0], law.W.size
        W, rest = np.flatnonzero(trained[:entries]), entries + np.flatnonzero(trained[entries:])
        index = np.concatenate([W, W, rest])
        factor = np.concatenate([scale[W], -scale[W], scale[rest]])
        rows = np.zeros((q if W.size else 0, index.size))
        if W.size:
            rows[np.tile(W // q, 2), np.arange(2 * W.size)] = 1.0
        return cls(tuple(part.shape for part in law), np.where(trained, 0.0, theta), index, factor, rows, kappa)

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.index.size

    @property
    def lower(self) -> Array:
        """Lower bounds of x: zero for W+ and W-, none for the rest."""
        return np.where(np.any(self.rows != 0, axis=0), 0.0, -np.inf)

    def parameters(self, x: Array) -> Parameters:
        """Return the matrices that x stands for."""
        return unflat(self.fixed + np.bincount(self.index, self.factor * x, self.fixed.size), self.shapes)

    def start(self, law: Parameters) -> Array:
        """Return an x strictly inside the constraints for a law; rows of W at the bound shrink by half a percent."""
        inside = 0.995 * self.kappa
        norms = np.abs(law.W).sum(axis=1, keepdims=True)
        W = law.W * np.minimum(1.0, inside / np.maximum(norms, 1e-300)) if self.rows.size else law.W
        x = flat(law._replace(W=W))[self.index] / self.factor
        # W+ and W- both get a little more than they need: the barrier wants an interior, and the law does not change.
        spare = 0.5 * (self.kappa - inside) / max(2 * law.W.shape[0], 1)
        return np.where(np.isfinite(self.lower), np.maximum(x, 0.0) + spare, x)


def flat(law: Parameters) -> Array:
    """Return the entries of W, U, V, K, b, d, each row by row."""
    return np.concatenate([np.ravel(part) for part in law])


def unflat(theta: Array, shapes: Sequence[tuple[int, ...]]) -> Parameters:
    """Return the matrices whose entries `flat` lists.

    >>> unflat(np.arange(6.0), [(1, 1)] * 4 + [(1,)] * 2).d.tolist()
    [5.0]
    """
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    return Parameters(*(part.reshape(shape) for part, shape in zip(np.split(theta, ends[:-1]), shapes, strict=True)))


class Minimand(Protocol):
    """What `nlp.minimize` asks of a goal: log(1 + J / scale) over the variables x of a layout, with derivatives.

    `Objective` answers to it, and so does `violation.Penalized`.
    """

    layout: Layout
    scale: float

    def value(self, x: Array) -> float:
        """Return log(1 + J / scale), NaN where J is not finite."""

    def gradient(self, x: Array) -> Array:
        """Return the gradient (nx,)."""

    def hessian(self, x: Array) -> Array:
        """Return a positive definite model of the Hessian (nx, nx)."""


class Objective:
    """log(1 + J / scale) over a layout and its derivatives, from batched rollouts.

    The logarithm has the minimizers of J and keeps the cost of a diverging law within reach of a line search. The last
    rollout is kept, since IPOPT asks for value, gradient and Hessian at one point in turn, and its hidden units start
    the next fixed point.

    scenario: what is minimized; sketch: the scenario of the Gauss-Newton Hessian, perhaps with fewer nodes; scale: the
    size of a good cost.
    """

    def __init__(self, scenario: Scenario, layout: Layout, scale: float, sketch: Scenario | None = None) -> None:
        self.scenario, self.layout, self.scale = scenario, layout, scale
        self.sketch = sketch or scenario
        self.values = 0
        self._damping, self._values_at_hessian = 1e-3, 0
        self._key = b""
        self._last: tuple[Parameters, Motion] | None = None
        self._guess: dict[int, Array | None] = {}

    def value(self, x: Array) -> float:
        """Return log(1 + J / scale), NaN where the loop is lost, so that the line search steps back."""
        cost = self._at(x)[1].cost
        return float(np.log1p(cost / self.scale)) if np.isfinite(cost) else np.nan

    def gradient(self, x: Array) -> Array:
        """Return the gradient of `value` (nx,)."""
        law, motion = self._at(x)
        theta = flat(gradient(self.scenario, law, motion))
        return theta[self.layout.index] * self.layout.factor / (self.scale + motion.cost)

    def hessian(self, x: Array) -> Array:
        """Return the damped Gauss-Newton Hessian of `value` (nx, nx); for one call per accepted step.

        The damping of Levenberg and Marquardt falls while full steps are accepted and rises when a step is cut twice.
        """
        law, motion = self._at(x)
        trials, self._values_at_hessian = self.values - self._values_at_hessian, self.values
        self._damping = float(np.clip(self._damping * (0.5 if trials <= 1 else 4.0 if trials > 2 else 1.0), *_DAMPING))
        seen = motion if self.sketch is self.scenario else self._rolled(self.sketch, law)
        H = gauss_newton(self.sketch, law, seen)[np.ix_(self.layout.index, self.layout.index)]
        H *= np.outer(self.layout.factor, self.layout.factor) / (self.scale + seen.cost)
        return H + self._damping * np.eye(x.size)

    def _at(self, x: Array) -> tuple[Parameters, Motion]:
        if self._last is None or self._key != x.tobytes():
            law = self.layout.parameters(x)
            self._last, self._key = (law, self._rolled(self.scenario, law)), x.tobytes()
            self.values += 1
        return self._last

    def _rolled(self, scenario: Scenario, law: Parameters) -> Motion:
        motion = roll(scenario, law, self._guess.get(id(scenario)))
        self._guess[id(scenario)] = motion.eta if np.isfinite(motion.cost) else None
        return motion
