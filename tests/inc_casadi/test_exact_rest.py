"""Equilibria in rational arithmetic: every equation holds exactly, on kinks and in saturated pieces too."""

from fractions import Fraction

import draws
import multiplier_draws as md
import numpy as np
import pytest

from inc_casadi import INC, Identity, LeakyReLU, Plant, ReLU, Saturation, Tanh, equilibrium
from inc_casadi.blocks import exact
from inc_casadi.exact_rest import LARGEST, rest_point

UNITS = (ReLU(), Saturation(), md.DEAD_ZONE, md.THREE, LeakyReLU(0.3), Identity())


def exact_value(unit, z):
    """phi(z) in fractions, from the pieces."""
    p = unit.pieces
    j = sum(z > Fraction(float(kink)) for kink in p.kinks)
    return Fraction(float(p.slopes[j])) * z + Fraction(float(p.intercepts[j]))


def settles(plant, inc, rest):
    """Whether every equation of eq:equilibrium_incremental holds without any rounding."""
    eta = np.array([exact_value(unit, z) for unit, z in zip(inc.activations, rest.z, strict=True)], dtype=object)
    A, B, C, W, U, V, K, b, d = (
        exact(part) for part in (plant.A, plant.B, plant.C, inc.W, inc.U, inc.V, inc.K, inc.b, inc.d)
    )
    y = C @ rest.x
    ahead = rest.x if plant.discrete else 0 * rest.x
    return (
        np.all(W @ eta + U @ y + b == rest.z)
        and np.all(K @ y + V @ eta + d == rest.u)
        and np.all(A @ rest.x + B @ rest.u == ahead)
    )


@pytest.mark.parametrize("dt", [1.0, 0.0])
@pytest.mark.parametrize("seed", range(8))
def test_every_equation_holds_exactly_and_newton_agrees(seed, dt):
    rng = np.random.default_rng(seed)
    plant, inc = draws.plant(rng, dt=dt), draws.controller(rng, units=UNITS, gain=0.02, bias=1.5)
    rest = rest_point(plant, inc)
    assert settles(plant, inc, rest)
    found = equilibrium(plant, inc)
    np.testing.assert_allclose(rest.x.astype(float), found.x, atol=1e-8)
    np.testing.assert_allclose(rest.z.astype(float), found.z, atol=1e-8)
    np.testing.assert_allclose(rest.u.astype(float), found.u, atol=1e-8)


@pytest.mark.parametrize(
    "rest", [(0.0, 1.0, -0.5, 2.0, 0.0, 0.5), (0.0, -1.0, 1.0, 0.25, 0.0, 0.0), (-2.0, 3.0, 1.5, 4.0, -1.0, 1.0)]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_rest_on_kinks_or_in_saturated_pieces(rest, seed):
    units = (*UNITS[:4], LeakyReLU(0.25), Identity())  # values with few digits: the biases are those of this very rest
    plant, inc = md.square_loop(np.random.default_rng(seed), units, dyadic=True, rest=rest)
    found = rest_point(plant, inc)
    assert found.z.tolist() == [Fraction(level) for level in rest] and settles(plant, inc, found)


def test_by_hand():
    # x+ = 0.5 x + relu(b): x = 2 b with b = 0.1 as stored; with b < 0 the unit sleeps and x = 0.
    plant = Plant([[0.5]], [[1.0]])
    assert rest_point(plant, INC([[0.0]], [[0.0]], [[1.0]], [[0.0]], b=[0.1])).x.tolist() == [2 * Fraction(0.1)]
    asleep = rest_point(plant, INC([[0.0]], [[0.0]], [[1.0]], [[0.0]], b=[-0.1]))
    assert asleep.x.tolist() == [0] and asleep.z.tolist() == [Fraction(-0.1)] and asleep.u.tolist() == [0]
    linear = rest_point(plant, INC(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[0.25]], d=[1.0]))
    assert linear.x.tolist() == [4] and linear.z.tolist() == [] and linear.u.tolist() == [2]


def test_units_move_to_the_pieces_that_their_exact_levels_lie_in():
    # x = 0.5 x + relu(b - x) + d with b = d: asleep at x = 2 d. Newton's method is content with x = 0, where the unit is
    # awake; the equations of that piece have the solution x = 4 d / 3, at which it is not.
    tiny = 2.0**-40
    found = rest_point(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], b=[tiny], d=[tiny]))
    assert found.x.tolist() == [2 * Fraction(tiny)] and found.z.tolist() == [-Fraction(tiny)]


def test_the_origin_is_taken_where_it_is_one_of_several():
    # x = 0.5 x + 3 relu(x - 1) at 0 and at 1.2; with 3 relu(x + 1) - 3 in place of it at 0 only.
    for b, d, level in ((-1.0, 0.0, -1), (1.0, -3.0, 1)):
        several = INC(np.zeros((1, 1)), [[1.0]], [[3.0]], [[0.0]], b=[b], d=[d])
        found = rest_point(Plant([[0.5]], [[1.0]]), several)
        assert found.x.tolist() == [0] and found.z.tolist() == [level] and found.u.tolist() == [0]


def test_a_rest_so_near_a_kink_that_floats_cannot_tell_its_side():
    # x = u = relu(z) with z = 2^-60 - 2^-60 x: awake, by less than Newton's tolerance, and exactly so.
    tiny = 2.0**-60
    found = rest_point(Plant([[0.0]], [[1.0]]), INC([[0.0]], [[-tiny]], [[1.0]], [[0.0]], b=[tiny]))
    assert found.z[0] == Fraction(tiny) / (1 + Fraction(tiny)) == found.x[0]
    asleep = rest_point(Plant([[0.0]], [[1.0]]), INC([[0.0]], [[-tiny]], [[1.0]], [[0.0]], b=[-tiny]))
    assert asleep.x.tolist() == [0] and asleep.z.tolist() == [-Fraction(tiny)]


@pytest.mark.parametrize(
    ("plant", "inc"),
    [
        (Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[0.1]], [[0.0]], b=[1.0], activation=Tanh())),
        (Plant([[1.0]], [[1.0]]), INC(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[0.0]], d=[1.0])),
        (Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], b=[1.0])),  # x = 0.5 x + relu(x + 1): none
        (
            Plant(0.5 * np.eye(LARGEST), np.ones((LARGEST, 1)), np.eye(1, LARGEST)),
            INC([[0.0]], [[1.0]], [[0.0]], [[0.0]], b=[1.0]),
        ),
    ],
)
def test_none_where_none_is_settled(plant, inc):
    assert rest_point(plant, inc) is None
