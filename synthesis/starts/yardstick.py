"""What a law costs beside the saturated regulator and the constrained optimum, from the same initial states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.arrays import Array, columns
from inc_casadi.bounds.moves import rollout
from inc_casadi.bounds.sequences import costs, optimal_sequences
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

Law = Callable[[Array], Array]
NOTHING = 1e-9  # a gap below this share of the optimum is rounding
LOST = 1e8  # a state this many times as large as any at the beginning does not come back


@dataclass(frozen=True, eq=False)
class Yardstick:
    """Costs over `steps` moves with x_T'P x_T after them, from each column of x0, as evidence and not as a bound.

        J(x_0) = sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T x_T'P x_T,   P of the discounted LQR.

    regulator (N,): of u = clip(K x), which reads the state; optimum (N,): of the best input sequence, by an interior-point
    method. Without limits x'P x is the least cost, so J is at most the true cost of a law, equal to it once the motion
    ends where limits no longer matter, and no controller whatever has a smaller J than the best sequence. From states where
    rounding spoils long sequences of an unstable plant, so that they cost more than the regulator, T is halved until they
    do not: the least cost over fewer moves is smaller still.

    plant, spec, x0 (n, N), steps, K (m, n), P (n, n).
    """

    plant: Plant
    spec: Spec
    x0: Array
    steps: int
    K: Array
    P: Array

    def costs(self, law: Law) -> Array:
        """Return J (N,) of a law of the measurement, y (p, N) -> u (m, N); infinite where the motion is lost."""
        return self._along(lambda x: law(self.plant.C @ x))

    def closed(self, law: Law) -> float:
        """Return the share of the gap between regulator and optimum that a law closes on average; 1 where there is none.

        States that the regulator loses are left out, for the gap is infinite there.
        """
        held = np.isfinite(self.regulator)
        regulator, optimum = self.regulator[held], self.optimum[held]
        gap, won = float(np.sum(regulator - optimum)), float(np.sum(regulator - self.costs(law)[held]))
        return won / gap if gap > NOTHING * float(np.sum(optimum)) else 1.0

    @cached_property
    def regulator(self) -> Array:
        """J of the clipped LQR from each state."""
        limits = self.spec.inputs
        assert isinstance(limits, Box)
        return self._along(lambda x: np.clip(self.K @ x, limits.lower[:, None], limits.upper[:, None]))

    @cached_property
    def optimum(self) -> Array:
        """J of the best sequence of inputs from each state."""
        least, T = np.sum(self.x0 * (self.P @ self.x0), axis=0), self.steps
        left = np.arange(len(least))
        while left.size and T > 0:
            found = self._sequences(self.x0[:, left], T)
            sound = (found <= (1 + NOTHING) * self.regulator[left]) & (found >= (1 - NOTHING) * least[left])
            least[left[sound]] = found[sound]
            left, T = left[~sound], T // 2
        return least

    def _sequences(self, x0: Array, T: int) -> Array:
        limits = self.spec.inputs
        assert isinstance(limits, Box)
        with np.errstate(over="ignore", invalid="ignore"):
            u = optimal_sequences(self.plant, self.spec, limits, self.P, x0, T).u
            return costs(self.spec, self.P, rollout(self.plant.A, self.plant.B, x0, u), u)

    def _along(self, law: Law) -> Array:
        x, u, lost = [self.x0], [], np.zeros(self.x0.shape[1], dtype=bool)
        most = LOST * float(np.max(np.abs(self.x0)))
        for _ in range(self.steps):
            u.append(law(x[-1]))
            after = self.plant.A @ x[-1] + self.plant.B @ u[-1]
            lost |= ~(np.max(np.abs(after), axis=0) <= most)
            x.append(np.where(lost, 0.0, after))
        return np.where(lost, np.inf, costs(self.spec, self.P, np.stack(x), np.stack(u)))


def yardstick(plant: Any, spec: Spec, x0: ArrayLike | None = None, steps: int | None = None, samples: int = 200,
              seed: int = 0) -> Yardstick:
    """Return the yardstick of a problem with a box of inputs.

    x0: (n,) or columns (n, N); `samples` draws of the initial distribution when left out; steps: T, by default until the LQR
    loop has contracted to a millionth, within 60 and 200; seed: of the draws.

    Raises InvalidInputError for a continuous plant or limits that are not a box; NotStabilizableError, SolverError as
    `discounted_lqr`.

    >>> plant, limits = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]]), Box([-1.0], [1.0])
    >>> spec = Spec(Q=np.eye(2), R=1.0, discount=1.0, initial=Box([-5, -5], [5, 5]), inputs=limits)
    >>> measured = yardstick(plant, spec, [[10.0, 5.0, 0.0], [0.0, 2.0, 5.0]], 150)  # published: 320.283, 215.667, 938.672
    >>> measured.optimum.round(3).tolist(), measured.regulator.round(3).tolist()
    ([320.283, 215.667, 938.672], [320.34, 215.667, 941.975])
    """
    plant = as_plant(plant)
    spec.check(plant)
    if not plant.discrete:
        raise InvalidInputError("costs are sums over steps, but the plant is continuous (dt = 0): plant.sampled(dt)")
    if not isinstance(spec.inputs, Box):
        raise InvalidInputError(f"inputs is {spec.inputs!r}, but the saturated regulator needs a Box to be clipped to")
    K, P = discounted_lqr(plant, spec)
    if x0 is None:
        x0 = spec.initial.sample(whole("samples", samples, 1), np.random.default_rng(seed))
    return Yardstick(plant, spec, columns("x0", x0, plant.n)[0], _settling(plant, spec, K) if steps is None
                     else whole("steps", steps, 1), K, P)


def _settling(plant: Plant, spec: Spec, K: Array) -> int:
    radius = np.sqrt(spec.discount) * float(np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ K))))
    return int(np.clip(np.ceil(np.log(1e-6) / np.log(radius)), 60, 200)) if 0 < radius < 1 else 60
