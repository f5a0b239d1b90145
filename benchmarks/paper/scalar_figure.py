"""What the text says of fig:scalar_separation: slopes, steps to the origin, and the gap at every discount shown."""

from __future__ import annotations

import numpy as np

from benchmarks.plants import scalar
from inc_casadi import INC, bounds, simulate
from inc_casadi.arrays import Array
from inc_casadi.linear.static_gain import best_static_gain

from .row import Row, formula
from .separation import exact_cost, two_relu_law

SOURCE = "fig:scalar_separation"
SHOWN = np.linspace(0.1, 1.0, 10)
GRID = np.linspace(-1.0, 1.0, 2001)
CORNER = 2 / 3  # where 1.5 x meets the limit
STEPS, AT_REST = 60, 1e-12


def rows() -> list[Row]:
    """Return the rows of the section, each from the law, the bound or the gain that this toolbox gives."""
    law, linear = two_relu_law(), INC.linear(best_static_gain(*scalar()[:2]).F)
    inner, outer = GRID[np.abs(GRID) < CORNER], GRID[np.abs(GRID) > CORNER]
    return [
        Row("best linear first move, slope farthest from -1", formula(-1.0, 6), farthest(first_slopes(), -1.0), SOURCE),
        Row("two-ReLU law, slope farthest from -1.5 for |x| < 2/3", formula(-1.5),
            farthest(law.jacobian(inner[None]), -1.5), SOURCE),
        Row("two-ReLU law, |u| farthest from 1 for |x| > 2/3", formula(1.0),
            farthest(np.abs(law(outer[None])), 1.0), SOURCE),
        Row("two-ReLU law, steps to the origin from [-1, 1]", "2", steps_to_the_origin(law), SOURCE, "<="),
        Row("best static gain, steps to the origin: more than 2", "3", steps_to_the_origin(linear), SOURCE, ">="),
        Row("least gap per discount, beta = 0.1 to 1", formula(1 / 18, 6), float(np.min(gaps() / SHOWN)), SOURCE),
    ]


def first_slopes() -> Array:
    """Return the slope of the best admissible linear first move at each discount shown, (k,).

    It is the minimizer of the bound's quadratic program, which is strictly convex: there is one.
    """
    return np.array([bounds.first_move(*scalar(float(beta))[:2]).moves[0, 0, 0] for beta in SHOWN])  # type: ignore[attr-defined]


def steps_to_the_origin(law: INC, starts: Array = GRID) -> int:
    """Return the first k with |x_j| <= 1e-12 for all j >= k and all starts (N,), as far as 60 steps; else 61.

    >>> steps_to_the_origin(INC.linear([[-1.5]])), steps_to_the_origin(INC.linear([[0.0]]), np.array([1.0]))
    (1, 61)
    """
    x = simulate(scalar().plant, law, starts[None], steps=STEPS).x
    moving = ~np.all(np.abs(x) <= AT_REST, axis=(0, 1))
    return int(np.max(np.nonzero(moving)[0], initial=-1)) + 1


def gaps() -> Array:
    """Return, at each discount shown, what linear controllers cost at least less the exact cost of the law, (k,)."""
    cases = [scalar(float(beta)) for beta in SHOWN]
    return np.array([float(bounds.first_move(*case[:2])) - exact_cost(case, two_relu_law()) for case in cases])


def farthest(values: Array, wanted: float) -> float:
    """Return the value that is farthest from the wanted one.

    >>> farthest(np.array([1.0, 1.2, 0.9]), 1.0)
    1.2
    """
    values = np.ravel(values)
    return float(values[np.argmax(np.abs(values - wanted))])
