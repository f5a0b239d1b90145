"""Training by projected gradients: the inner loop of the paper's Algorithm 1, in NumPy alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from inc_casadi.arrays import Array

from .ball import project_rows
from .objective import Layout, Objective, flat, unflat
from .outcome import Outcome, Progress, Track
from .rollout import Motion, Parameters, gradient, roll

_SUFFICIENT, _MEMORY, _HALVINGS = 1e-4, 5, 30  # Armijo's share, past values that a step may not exceed, most cuts
_RANGE = (1e-8, 1e4)  # of step lengths
_RATE, _DECAY, _FORGET = 0.03, (0.9, 0.999), 0.01  # Adam: step, memories, final step as a share of the first
_STILL, _PATIENCE = 1e-6, 10  # relative gain over so many steps below which the search ends


@dataclass(frozen=True, eq=False)
class _Space:
    """The entries that are trained, in their units: theta = fixed + factor * x at `index`; W as it is, not split."""

    layout: Layout
    index: np.ndarray
    factor: Array

    @classmethod
    def of(cls, layout: Layout) -> _Space:
        """Return the space of a layout, its W+ standing for W."""
        entries = layout.rows.shape[0] ** 2
        kept = np.r_[0:entries, 2 * entries:layout.size]
        return cls(layout, layout.index[kept], layout.factor[kept])

    def project(self, x: Array) -> Array:
        """Return the nearest x with ||W||_inf <= kappa: W has unit scale, so this is the Euclidean projection."""
        q = self.layout.rows.shape[0]
        return np.concatenate([project_rows(x[:q * q].reshape(q, q), self.layout.kappa).ravel(), x[q * q:]])

    def law(self, x: Array) -> Parameters:
        """Return the matrices that x stands for."""
        theta = self.layout.fixed.copy()
        theta[self.index] = self.factor * x
        return unflat(theta, self.layout.shapes)

    def point(self, law: Parameters) -> Array:
        """Return the x of a law, projected."""
        return self.project(flat(law)[self.index] / self.factor)


@dataclass
class _Value:
    """log(1 + J / scale) and its gradient; each rollout starts its fixed points from the last accepted one."""

    objective: Objective
    space: _Space
    guess: Array | None = None

    def at(self, x: Array) -> tuple[float, Parameters, Motion]:
        """Return the value, infinite where the loop is lost, with the law and its motion."""
        law = self.space.law(x)
        motion = roll(self.objective.scenario, law, self.guess)
        return float(np.log1p(motion.cost / self.objective.scale)), law, motion

    def slope(self, law: Parameters, motion: Motion) -> Array:
        """Return the gradient by the adjoint of prop:implicit_gradients."""
        self.guess = motion.eta
        theta = flat(gradient(self.objective.scenario, law, motion))
        return theta[self.space.index] * self.space.factor / (self.objective.scale + motion.cost)


def descend(objective: Objective, start: Parameters, *, steps: str = "spectral", max_iterations: int = 100,
            time_limit: float | None = None, progress: Progress | None = None) -> Outcome:
    """Return the best law that projected gradients find from a start (Algorithm 1, step 2).

    x <- Pi(x - a grad log(1 + J / scale)), with Pi the row-wise projection of W on the l1 ball of radius kappa and the
    gradient by adjoints over all nodes; so every iterate is well posed (prop:projected_training_wp).

    Parameters
    ----------
    objective : what is minimized and over which entries
    start : must have a finite cost, else it comes back
    steps : "spectral": a is tried at dx'dx / dx'dg of Barzilai and Borwein and halved until the value lies 1e-4 |dx|^2 / a
        below the largest of the last five (Armijo's rule on the projected arc, not monotone); "adam": fixed steps by
        moments of the gradient, falling to a hundredth over max_iterations, no search
    max_iterations : accepted steps
    time_limit : seconds
    progress : called with (iteration, cost, seconds)

    Notes
    -----
    Birgin, Martinez and Raydan, Nonmonotone spectral projected gradient methods on convex sets, SIAM J. Optim. 10,
    2000; Kingma and Ba, Adam, ICLR 2015. The rules stand still at kinks at times, where no gradient descends.
    """
    track = Track(progress, np.inf if time_limit is None else time_limit)
    space = _Space.of(objective.layout)
    value = _Value(objective, space)
    walk = _adaptive(value, space.point(start), max_iterations) if steps == "adam" else \
        _searched(value, space.point(start))
    status = "no more progress"
    try:
        for iteration, (law, cost) in enumerate(walk):
            track.note(law, cost)
            if iteration >= max_iterations or track.late:
                status = "time limit" if track.late else "iteration limit"
                break
            if steps != "adam" and _still(track):
                break
    except KeyboardInterrupt:
        status = "interrupted"
    return track.outcome(start, status)


def _still(track: Track) -> bool:
    if len(track.history) <= 2 * _PATIENCE:
        return False
    costs = [cost for _, cost, _ in track.history]
    before = min(costs[:-_PATIENCE])
    return before - min(costs[-_PATIENCE:]) <= _STILL * abs(before)


def _searched(value: _Value, x: Array) -> Iterator[tuple[Parameters, float]]:
    """Yield laws and costs of steps found by backtracking along the projected arc; end when none descends."""
    f, law, motion = value.at(x)
    yield law, motion.cost
    if not np.isfinite(f):
        return
    g, past = value.slope(law, motion), [f]
    a = 0.1 / max(float(np.linalg.norm(g)), 1e-12)
    while True:
        bar = max(past[-_MEMORY:])
        for _ in range(_HALVINGS):
            moved = value.space.project(x - a * g)
            dx = moved - x
            if not np.any(dx):
                return
            f, law, motion = value.at(moved)
            if f <= bar - _SUFFICIENT / a * float(dx @ dx):
                break
            a /= 2.0 if np.isfinite(f) else 10.0
        else:
            return
        yield law, motion.cost
        slope = value.slope(law, motion)
        curvature = float(dx @ (slope - g))
        a = float(np.clip(float(dx @ dx) / curvature if curvature > 0.0 else 4.0 * a, *_RANGE))
        x, g = moved, slope
        past.append(f)


def _adaptive(value: _Value, x: Array, most: int) -> Iterator[tuple[Parameters, float]]:
    """Yield laws and costs of Adam's steps, each projected; a step into a lost loop is taken back and halved."""
    mean, square, rate = np.zeros_like(x), np.zeros_like(x), _RATE
    first, second = _DECAY
    f, law, motion = value.at(x)
    yield law, motion.cost
    k, back = 0, x
    while np.isfinite(f) or k:
        if not np.isfinite(f):
            x, rate = back, rate / 2
            f, law, motion = value.at(x)
        g, back, k = value.slope(law, motion), x, k + 1
        mean, square = first * mean + (1 - first) * g, second * square + (1 - second) * g**2
        step = rate * _FORGET ** min(k / max(most, 1), 1.0)
        x = value.space.project(x - step * (mean / (1 - first**k)) / (np.sqrt(square / (1 - second**k)) + 1e-12))
        f, law, motion = value.at(x)
        yield law, motion.cost
