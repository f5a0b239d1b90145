"""What simulation says: mean discounted cost with its standard error. Evidence, never a certificate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .arrays import Array
from .brief import Brief
from .plant import Plant
from .simulate import quadratic
from .spec import Spec

Law = Callable[[Array], Array]
DIVERGED = 1e8
NEGLIGIBLE = 1e-10
WATCHED = 500


@dataclass(frozen=True, eq=False)
class Estimate(Brief):
    """Simulated expected cost: mean and standard_error over `samples` seeded starting points, infinite on divergence.

    largest: the largest sampled cost; excess: the largest violation H u - h of an input limit seen, at most 0 when all
    were kept, -inf without limits; steps: how long the motions were followed; settled: whether they came to rest and the
    cost that was left out is negligible. A discount can make the cost of motions that never rest finite: then
    `settled` is False.
    """

    mean: float
    standard_error: float
    largest: float
    excess: float
    samples: int
    steps: int
    settled: bool


def estimate(plant: Plant, law: Law, spec: Spec, *, samples: int = 20_000, seed: int = 0, steps: int = 3_000) -> Estimate:
    """Return the simulated cost of a law from seeded samples of the initial distribution, in discrete time.

    Motions are followed until the stage cost still to come is negligible, diverges, or `steps` are over.

    law: an INC, or anything that answers columns of measurements y (p, N) with columns of inputs u (m, N).

    >>> from inc_casadi import INC, Box
    >>> spec = Spec([[1.0]], [[0.0]], 1.0, Box([-1.0], [1.0]))
    >>> run = estimate(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), spec, samples=2000)
    >>> abs(run.mean - 4 / 9) < 4 * run.standard_error
    True
    """
    x = np.array(spec.initial.sample(samples, np.random.default_rng(seed)))
    size = float(np.max(np.abs(x)))
    total, weight, excess, settled = np.zeros(samples), 1.0, -np.inf, False
    step = 0
    for step in range(1, steps + 1):
        u = law(plant.C @ x)
        if spec.inputs is not None:
            excess = max(excess, float(np.max(spec.inputs.H @ u - spec.inputs.h[:, None])))
        stage = weight * (quadratic(spec.Q, x) + quadratic(spec.R, u))
        total += stage
        x = plant.A @ x + plant.B @ u
        weight *= spec.discount
        if not np.max(np.abs(x)) < DIVERGED:
            return Estimate(np.inf, np.inf, np.inf, excess, samples, step, False)
        # A geometric tail no slower than 0.99 per step is below a hundred such stages.
        if np.max(stage) * 100 <= NEGLIGIBLE * max(float(total.mean()), 1e-300):
            settled = _comes_to_rest(plant, law, x[:, :WATCHED], size, steps)
            break
    error = float(total.std(ddof=1) / np.sqrt(samples))
    return Estimate(float(total.mean()), error, float(total.max()), excess, samples, step, settled)


def _comes_to_rest(plant: Plant, law: Law, x: Array, size: float, steps: int) -> bool:
    """Whether the last motion of some samples dies out: a step moves less than a millionth of where they began."""
    for _ in range(steps):
        after = plant.A @ x + plant.B @ law(plant.C @ x)
        if not np.max(np.abs(after)) < DIVERGED:
            return False
        if np.max(np.abs(after - x)) <= 1e-6 * size:
            return True
        x = after
    return False
