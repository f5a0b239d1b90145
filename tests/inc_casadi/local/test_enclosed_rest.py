"""Equilibria of loops with curved units: enclosed, unique in the box, and refused where nothing is proved."""

from decimal import Decimal, getcontext

import numpy as np
import pytest
from neural_draws import MIXED, neural, two_layers

from inc_casadi import INC, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.errors import NoEquilibriumError
from inc_casadi.local.enclosed_rest import enclosed_rest
from inc_casadi.local.rest import rest_of
from inc_casadi.loop import equilibrium

getcontext().prec = 50


def tanh(z):
    grown = (2 * z).exp()
    return (grown - 1) / (grown + 1)


def test_the_box_holds_the_solution_to_fifty_digits():
    # x = 1.3 x - 2 tanh(x - 1/2) + 1/10 in discrete time: Newton in fifty digits from the float solution.
    inc = INC([[0.0]], [[1.0]], [[-2.0]], [[0.0]], b=[-0.5], d=[0.1], activation=Tanh())
    loop = close_loop(Plant([[1.3]], [[1.0]]), inc)
    x = Decimal(float(equilibrium(loop.plant, inc).x[0]))
    a, d = Decimal(1.3), Decimal(0.1)
    for _ in range(6):
        t = tanh(x - Decimal("0.5"))
        x -= ((a - 1) * x - 2 * t + d) / ((a - 1) - 2 * (1 - t * t))
    rest = enclosed_rest(loop)
    low, high = (Decimal(end[0].numerator) / Decimal(end[0].denominator) for end in (rest.x_low, rest.x_high))
    assert low < x < high < low + Decimal("1e-13")
    u = -2 * tanh(x - Decimal("0.5")) + d
    low, high = (Decimal(end[0].numerator) / Decimal(end[0].denominator) for end in (rest.u_low, rest.u_high))
    assert low <= u <= high


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("dt", [1.0, 0.0])
def test_equilibria_of_random_loops_lie_in_small_boxes(seed, dt):
    rng = np.random.default_rng(seed)
    plant, inc = neural(rng, MIXED, n=3, m=2, bias=0.3, feedback=0.5) if seed % 2 else two_layers(rng, bias=0.3)
    plant = Plant(plant.A if dt else plant.A - 0.9 * np.eye(plant.n), plant.B, dt=dt)
    rest = enclosed_rest(close_loop(plant, inc))
    try:
        at = equilibrium(plant, inc, tolerance=1e-13)
    except NoEquilibriumError:
        assert rest is None and (seed, dt) == (5, 0.0)
        return
    for low, high, point in ((rest.x_low, rest.x_high, at.x), (rest.z_low, rest.z_high, at.z),
                             (rest.u_low, rest.u_high, at.u)):
        width = (high - low).astype(float)
        assert np.all(width < 1e-10)
        assert np.all(np.abs(((low + high) / 2).astype(float) - point) < 1e-9)


def test_piecewise_affine_loops_agree_with_the_exact_equilibrium():
    inc = INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], b=[0.25], activation=Saturation())
    rest = enclosed_rest(close_loop(Plant([[1.5]], [[1.0]]), inc))
    assert rest.x_low[0] <= 0.5 <= rest.x_high[0] and rest.x_high[0] - rest.x_low[0] < 1e-13


def test_a_kink_between_two_equilibria_or_none_proves_nothing():
    # x+ = x - relu(x) rests at every x <= 0; x+ = x + 1 + tanh(x) / 2 moves up everywhere.
    flat = INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=ReLU())
    assert enclosed_rest(close_loop(Plant([[1.0]], [[1.0]]), flat)) is None
    none = INC([[0.0]], [[1.0]], [[0.5]], [[0.0]], d=[1.0], activation=Tanh())
    assert enclosed_rest(close_loop(Plant([[1.0]], [[1.0]]), none)) is None


def test_the_rest_of_a_biased_tanh_loop_is_known():
    plant, inc = two_layers(np.random.default_rng(1), bias=0.3)
    rest = rest_of(close_loop(plant, inc))
    assert rest is not None and np.any(rest.z_low != rest.z_high)
