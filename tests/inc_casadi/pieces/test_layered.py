"""Laws summed level by level with more places are those solved in Fractions, to less than two roundings."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import INC, LeakyReLU, Plant, ReLU, Saturation
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.layered import layered_laws


def layered_loop(seed):
    """Three levels of mixed units, large weights, n = 3, p = 2, m = 2."""
    rng = np.random.default_rng(seed)
    sizes = (4, 3, 2)
    q = sum(sizes)
    W = np.zeros((q, q))
    W[4:7, :4], W[7:, 4:7], W[7:, :4] = (8 * rng.standard_normal(shape) for shape in ((3, 4), (2, 3), (2, 4)))
    units = tuple(rng.permutation([ReLU(), LeakyReLU(0.3), Saturation()] * 3))
    order = rng.permutation(q)
    inc = INC(W[np.ix_(order, order)], rng.standard_normal((q, 2)), rng.standard_normal((2, q)), rng.standard_normal((2, 2)),
              rng.standard_normal(q), rng.standard_normal(2), units)
    return Plant(0.5 * np.eye(3), rng.standard_normal((3, 2)), rng.standard_normal((2, 3))), inc


@pytest.mark.parametrize("seed", range(3))
def test_they_are_the_fractions_to_two_roundings(seed):
    plant, inc = layered_loop(seed)
    exactly, places = (PiecewiseLoop(plant, inc, kind) for kind in ("exact", "fixed"))
    points = 2 * np.random.default_rng(seed).standard_normal((12, 3))
    patterns = PiecewiseLoop(plant, inc).patterns_at(points)
    true, found = exactly.laws(patterns), layered_laws(places, patterns)
    for name in ("Zx", "z0", "Gx", "g"):
        stated = getattr(found, name)
        gap = [abs(Fraction(int(n), 1 << 256) - value) for n, value in zip(stated.ravel(), getattr(true, name).ravel(),
                                                                          strict=True)]
        assert max(gap) < Fraction(2, 1 << 256), name
    np.testing.assert_array_equal(found.low, PiecewiseLoop(plant, inc).laws(patterns).low)


def test_a_loop_of_units_is_left_to_fractions():
    inc = INC([[0.0, 0.2], [0.3, 0.0]], [[1.0], [1.0]], [[1.0, 1.0]], [[0.0]])
    loop = PiecewiseLoop(Plant([[0.5]], [[1.0]]), inc, "fixed")
    assert layered_laws(loop, np.array([[0, 1]])) is None
