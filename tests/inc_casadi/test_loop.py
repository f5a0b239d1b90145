"""Closing the loop: the stacked matrices against the definition, exact copies, equilibria."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import INC, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh, close_loop, equilibrium
from inc_casadi.errors import DimensionError, NoEquilibriumError
from inc_casadi.readings import Rational, Rounded

N, M, P, Q = 4, 2, 3, 5


def draw(seed, biased=False):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    plant = Plant(0.5 * A / np.max(np.abs(np.linalg.eigvals(A))), rng.standard_normal((N, M)), rng.standard_normal((P, N)))
    W = rng.standard_normal((Q, Q))
    W *= 0.7 / np.abs(W).sum(axis=1, keepdims=True)
    units = (ReLU(), LeakyReLU(0.3), Saturation(), Tanh(), Logistic() if biased else ReLU())
    bias = (rng.standard_normal(Q), rng.standard_normal(M)) if biased else (None, None)
    inc = INC(W, 0.3 * rng.standard_normal((Q, P)), 0.2 * rng.standard_normal((M, Q)), 0.05 * rng.standard_normal((M, P)),
              *bias, units)
    return plant, inc


def test_stacked_matrices_reproduce_one_step_of_the_loop():
    plant, inc = draw(0)
    loop = close_loop(plant, inc)
    x = np.random.default_rng(1).standard_normal(N)
    y = plant.C @ x
    eta, u = inc.hidden(y), inc(y)
    s = np.concatenate([x, eta])
    np.testing.assert_allclose(loop.F @ s, plant.A @ x + plant.B @ u, atol=1e-10)
    np.testing.assert_allclose(loop.G @ s, u, atol=1e-10)
    np.testing.assert_allclose(loop.Z @ s, inc.W @ eta + inc.U @ y, atol=1e-10)
    np.testing.assert_array_equal(loop.X @ s, x)
    np.testing.assert_array_equal(loop.H @ s, eta)


def test_deviations_from_an_equilibrium_obey_the_same_matrices():
    plant, inc = draw(2, biased=True)
    loop, rest = close_loop(plant, inc), equilibrium(plant, inc)
    x = rest.x + np.random.default_rng(3).standard_normal(N)
    eta = inc.hidden(plant.C @ x)
    s = np.concatenate([x - rest.x, eta - rest.eta])
    after = plant.A @ x + plant.B @ inc(plant.C @ x)
    np.testing.assert_allclose(loop.F @ s, after - rest.x, atol=1e-9)
    np.testing.assert_allclose(loop.Z @ s, inc.W @ eta + inc.U @ plant.C @ x + inc.b - rest.z, atol=1e-9)


def test_sector_facts_belong_to_the_origin_and_slopes_to_everything_else():
    loop = close_loop(*draw(0))
    assert loop.about == "origin" and loop.units == tuple(range(Q)) and loop.atoms == () and loop.center is None
    assert loop.lower.tolist() == [0, 0.3, 0, 0, 0] and loop.upper.tolist() == [1, 1, 1, 1, 1]
    biased = close_loop(*draw(0, biased=True))
    assert biased.about == "difference" and biased.upper.tolist() == [1, 1, 1, 1, 0.25]
    narrow = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]], activation=Narrow()))
    moved = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]], b=[1.0], activation=Narrow()))
    assert (narrow.lower.item(), moved.lower.item()) == (0.1, -0.5)


class Narrow(ReLU):
    """A unit that states a sector narrower than its slopes."""

    slopes = (-0.5, 1.0)
    sector = (0.1, 1.0)


def test_exact_loop_is_formed_without_rounding():
    plant, inc = Plant([[0.1]], [[0.2]]), INC([[0.3]], [[0.7]], [[1.1]], [[0.9]])
    loop = close_loop(plant, inc).read(Rational)
    A, B, K, V, U = (Fraction(v) for v in (0.1, 0.2, 0.9, 1.1, 0.7))
    assert loop.F.fractions().tolist() == [[A + B * K, B * V]] and loop.Z.fractions().tolist() == [[U, Fraction(0.3)]]
    assert loop.G.fractions().tolist() == [[K, V]] and loop.upper.fractions().tolist() == [Fraction(1)]
    assert loop.X.fractions().tolist() == [[1, 0]] and loop.H.fractions().tolist() == [[0, 1]]
    assert float(loop.F.fractions()[0, 0]) == pytest.approx(0.28)


def test_rounded_loop_bounds_what_rounding_did():
    loop = close_loop(*draw(0))
    rounded, true = loop.read(Rounded), loop.read(Rational)
    for name in ("F", "G", "Z", "X", "H", "lower", "upper"):
        gap = Rational.lift(getattr(rounded, name).value).fractions() - getattr(true, name).fractions()
        assert np.all(np.abs(gap) <= Rational.lift(getattr(rounded, name).error).fractions()), name


@pytest.mark.parametrize("noisy", [False, True])
def test_inputs_from_outside_enter_the_state_and_the_measurement(noisy):
    plant, inc = draw(0)
    rng = np.random.default_rng(5)
    E, D = rng.standard_normal((N, 2)), rng.standard_normal((P, 2)) if noisy else None
    loop = close_loop(plant, inc).with_inputs(E, D)
    x, w = rng.standard_normal(N), rng.standard_normal(2)
    y = plant.C @ x + (D @ w if noisy else 0)
    eta, u = inc.hidden(y), inc(y)
    s = np.concatenate([x, eta, w])
    np.testing.assert_allclose(loop.F @ s, plant.A @ x + plant.B @ u + E @ w, atol=1e-10)
    np.testing.assert_allclose(loop.G @ s, u, atol=1e-10)
    np.testing.assert_allclose(loop.Z @ s, inc.W @ eta + inc.U @ y, atol=1e-10)
    np.testing.assert_array_equal(np.concatenate([loop.X @ s, loop.H @ s]), s[:-2])
    assert loop.inputs == 2 and loop.width == N + Q + 2
    true = close_loop(plant, inc).read(Rational).with_inputs(E, D)
    for name in ("F", "G", "Z"):
        np.testing.assert_allclose(getattr(true, name).fractions().astype(float), getattr(loop, name), atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_equilibrium_is_where_a_long_simulation_rests(seed):
    plant, inc = draw(seed, biased=True)
    rest = equilibrium(plant, inc)
    x = np.zeros(N)
    for _ in range(400):
        x = plant.A @ x + plant.B @ inc(plant.C @ x)
    np.testing.assert_allclose(rest.x, x, atol=1e-8)
    np.testing.assert_allclose(rest.u, inc(plant.C @ rest.x), atol=1e-12)
    assert rest.residual < 1e-9


def test_continuous_equilibrium_and_local_gain_by_hand():
    plant = Plant([[-2.0]], [[1.0]], dt=0)
    rest = equilibrium(plant, INC.linear([[1.0]]))
    assert rest.x[0] == 0
    biased = INC(np.zeros((1, 1)), [[1.0]], [[1.0]], [[0.0]], b=[3.0], activation=ReLU())
    rest = equilibrium(plant, biased)
    assert rest.x[0] == pytest.approx(3.0) and biased.jacobian(rest.y)[0, 0] == 1.0


def test_a_loop_without_equilibrium_says_so():
    with pytest.raises(NoEquilibriumError, match="residual of 1"):
        equilibrium(Plant([[1.0]], [[1.0]]), INC(np.zeros((0, 0)), [], [], [[0.0]], d=[1.0]))


def test_sizes_that_do_not_fit_name_both_sides():
    with pytest.raises(DimensionError, match="maps 2 measurements to 1 inputs, but the plant has 1 measurements and 1"):
        close_loop(Plant([[1.0]], [[1.0]]), INC.linear([[1.0, 2.0]]))
