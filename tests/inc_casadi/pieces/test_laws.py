"""The affine laws behind a piecewise-affine controller, against the controller itself and in Fractions."""

from fractions import Fraction

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Identity, LeakyReLU, Plant, ReLU, Saturation, Tanh
from inc_casadi.blocks import exact
from inc_casadi.errors import InvalidInputError
from inc_casadi.pieces.laws import PiecewiseLoop

UNITS = (ReLU(), Saturation(), LeakyReLU(0.25), Identity(), Saturation())


def draw(seed, arithmetic="float", units=UNITS):
    rng = np.random.default_rng(seed)
    q, n, p, m = len(units), 3, 4, 2
    W = rng.standard_normal((q, q))
    W *= 0.8 / np.abs(W).sum(axis=1).max()
    inc = INC(W, rng.standard_normal((q, p)), rng.standard_normal((m, q)), rng.standard_normal((m, p)),
              rng.standard_normal(q), rng.standard_normal(m), units)
    plant = Plant(rng.standard_normal((n, n)), rng.standard_normal((n, m)), rng.standard_normal((p, n)))
    return PiecewiseLoop(plant, inc, arithmetic)


@pytest.mark.parametrize("seed", range(3))
def test_the_law_of_the_pattern_at_a_point_is_the_controller_there(seed):
    loop = draw(seed)
    x = 2 * np.random.default_rng(seed).standard_normal((200, 3))
    patterns = loop.patterns_at(x)
    distinct, which = loop.distinct(patterns)
    np.testing.assert_array_equal(distinct[which], patterns)
    assert len(distinct) > 5
    laws = loop.laws(distinct)
    u = np.einsum("kmn,kn->km", laws.Gx[which], x) + laws.g[which]
    z = np.einsum("kqn,kn->kq", laws.Zx[which], x) + laws.z0[which]
    y = loop.plant.C @ x.T
    np.testing.assert_allclose(u.T, oracles.control(loop.inc, y), atol=1e-10)
    np.testing.assert_allclose(z.T, loop.inc.W @ oracles.hidden(loop.inc, y) + loop.inc.U @ y + loop.inc.b[:, None],
                               atol=1e-10)
    assert np.all(z >= laws.low[which] - 1e-10) and np.all(z <= laws.high[which] + 1e-10)


def test_any_guess_leads_to_the_pattern():
    loop = draw(5)
    x = 2 * np.random.default_rng(0).standard_normal((300, 3))
    most = [unit.pieces.slopes.size for unit in UNITS]
    guess = np.random.default_rng(1).integers(0, most, (300, 5))
    np.testing.assert_array_equal(loop.patterns_at(x, guess), loop.patterns_at(x))


def test_exact_laws_solve_the_fixed_point_equation_exactly():
    loop = draw(1, "exact")
    x = exact(np.random.default_rng(2).standard_normal((4, 3)))
    patterns = loop.patterns_at(x)
    laws = loop.laws(patterns)
    inc, plant = loop.inc, loop.plant
    for k in range(4):
        z = laws.Zx[k] @ x[k] + laws.z0[k]
        eta = np.array([_exact_unit(unit, value) for unit, value in zip(inc.activations, z, strict=True)], dtype=object)
        y = exact(plant.C) @ x[k]
        assert list(exact(inc.W) @ eta + exact(inc.U) @ y + exact(inc.b)) == list(z)
        assert list(exact(inc.K) @ y + exact(inc.V) @ eta + exact(inc.d)) == list(laws.Gx[k] @ x[k] + laws.g[k])


def _exact_unit(unit, z):
    assert isinstance(z, Fraction)
    name = type(unit).__name__
    if name == "ReLU":
        return max(z, Fraction(0))
    if name == "LeakyReLU":
        return max(z, z / 4)
    return max(Fraction(-1), min(z, Fraction(1))) if name == "Saturation" else z


def test_a_point_that_rounds_to_a_kink_is_settled_exactly():
    # z = x + 2^-80 exactly lies above the kink at 1 - though the nearest double lies on it, and below at 1 - 2^-80.
    loop = PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=Saturation()), "exact")
    points = exact(np.array([[1.0], [1.0], [1.0], [-1.0]]))
    points[0, 0] += Fraction(1, 2**80)
    points[1, 0] -= Fraction(1, 2**80)
    points[3, 0] -= Fraction(1, 2**80)
    for guess in (None, np.full((4, 1), 1), np.full((4, 1), 2), np.zeros((4, 1), int)):
        patterns = loop.patterns_at(points, guess)[:, 0].tolist()
        assert patterns[0] == 2 and patterns[1] == 1 and patterns[2] in (1, 2) and patterns[3] == 0


def test_many_units_have_distinct_patterns_too():
    loop = draw(0, units=(Saturation(),) * 45)
    patterns = np.random.default_rng(0).integers(0, 2, (20, 45))
    patterns[10:] = patterns[:10]
    distinct, which = loop.distinct(patterns)
    assert len(distinct) == 10
    np.testing.assert_array_equal(distinct[which], patterns)


def test_no_hidden_units_is_one_law():
    loop = PiecewiseLoop(Plant([[0.5]], [[2.0]]), INC.linear([[3.0]]))
    patterns = loop.patterns_at(np.array([[1.0], [2.0]]))
    assert patterns.shape == (2, 0)
    distinct, which = loop.distinct(patterns)
    assert len(distinct) == 1 and which.tolist() == [0, 0]
    assert loop.laws(distinct).Gx.tolist() == [[[3.0]]]


def test_a_smooth_unit_and_continuous_time_are_refused():
    with pytest.raises(InvalidInputError, match="hidden unit 1 has activation Tanh.*not piecewise affine"):
        PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC(np.zeros((2, 2)), np.ones((2, 1)), np.ones((1, 2)), [[0.0]],
                                                   activation=(ReLU(), Tanh())))
    with pytest.raises(InvalidInputError, match="sample the plant first"):
        PiecewiseLoop(Plant([[-0.5]], [[1.0]], dt=0.0), INC.linear([[0.0]]))
