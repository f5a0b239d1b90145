"""Whether a law brings motions to rest, by simulation, and how part of one that does not gives way to a linear gain."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from inc_casadi.arrays import Array
from inc_casadi.estimate import estimate
from inc_casadi.inc import INC
from inc_casadi.plant import Plant
from inc_casadi.spec import Spec

from .registry import lqr_gain
from .starts.random_start import measurement_range

Law = Callable[[Array], Array]
SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
SAMPLES, STEPS = 200, 3_000
NEARLY, STEP = 1e-9, 1e-4  # an input at the origin below the former is rounding; differences are over the latter


@dataclass(frozen=True, eq=False)
class Rest:
    """What simulation says: whether all motions came to rest, and the spectral radius of the loop at the origin, NaN where
    the law does not rest there."""

    settled: bool
    radius: float

    @property
    def holds(self) -> bool:
        """Whether nothing speaks against it; evidence, no proof."""
        return self.settled and not self.radius >= 1

    @property
    def sentence(self) -> str:
        """What was seen, in words.

        >>> Rest(True, 1.2).sentence
        'it does not settle: the loop at the origin has the spectral radius 1.2'
        """
        if self.holds:
            return "motions settle in simulation"
        if self.radius >= 1:
            return f"it does not settle: the loop at the origin has the spectral radius {self.radius:.6g}"
        return "it does not settle: simulated motions do not come to rest"


def rest(plant: Plant, spec: Spec, law: INC, seed: int = 0) -> Rest:
    """Return whether a law brings drawn initial states to rest, its input limits built in.

    >>> from inc_casadi import Box
    >>> rest(Plant(1.5, 1.0), Spec(1.0, 1.0, 0.9, Box(-1, 1)), INC.linear([[-0.2]])).holds
    False
    """
    y = np.zeros(law.p)
    radius = float("nan")
    if float(np.max(np.abs(law(y)))) <= NEARLY:
        radius = float(np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ law.jacobian(y) @ plant.C))))
    return Rest(estimate(plant, law, spec, samples=SAMPLES, seed=seed, steps=STEPS).settled, radius)


def local_gain(plant: Plant, spec: Spec, teacher: Law) -> Array:
    """Return the gain (m, p) that laws give way to: of the LQR where the state is measured, else the teacher's slope at 0.

    >>> from inc_casadi import Box
    >>> spec = Spec(np.eye(2), 1.0, 0.9, Box([-1, -1], [1, 1]))
    >>> local_gain(Plant(np.eye(2) / 2, [[0], [1]], [[1.0, 1.0]]), spec, lambda y: -0.4 * y).round(9).tolist()
    [[-0.4]]
    """
    if plant.p == plant.n and np.linalg.matrix_rank(plant.C) == plant.n:
        return np.asarray(np.linalg.solve(plant.C.T, lqr_gain(plant, spec).T).T)
    steps = STEP * np.diag(measurement_range(plant, spec))
    return np.asarray((teacher(steps) - teacher(-steps)) / (2 * np.diag(steps)))


def gives_way(inner: INC, gain: Array) -> Iterator[INC]:
    """Yield mixtures of a law and a gain F, t falling from 1 to 0, each with the slope F at the origin.

        u = t (inner(y) - inner(0) + (F - J) y) + (1 - t) F y,      J the slope of the inner law at y = 0.

    At t = 1 only the behaviour around the origin is mended, at t = 0 the units are idle and the law is the gain.

    >>> law = INC([[0.0]], [[1.0]], [[2.0]], [[0.5]], b=[-1.0])  # 0.5 y, and 2 (y - 1) more above 1
    >>> [(float(one.jacobian([0.0])[0, 0]), float(one([3.0])[0])) for one in gives_way(law, np.array([[-0.5]]))][::2]
    [(-0.5, 2.5), (-0.5, 0.5), (-0.5, -1.5)]
    """
    y = np.zeros(inner.p)
    mended = replace(inner, K=inner.K + gain - inner.jacobian(y), d=inner.d - inner(y))
    for share in SHARES:
        yield replace(mended, V=share * mended.V, K=share * mended.K + (1 - share) * gain, d=share * mended.d)
