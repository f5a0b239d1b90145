"""Every fact that an activation states is sampled on its graph, at kinks too."""

import casadi
import numpy as np
import pytest

from inc_casadi.activations import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh
from inc_casadi.activations.stack import as_units, evaluate, lipschitz, sectors
from inc_casadi.errors import DimensionError, InvalidInputError

ALL = [ReLU(), LeakyReLU(0.0), LeakyReLU(0.3), LeakyReLU(1.0), Saturation(), Tanh(), CenteredLogistic(), Logistic(),
       Identity()]
GRID = np.unique(np.concatenate([np.linspace(-7, 7, 281), [-1.0, 0.0, 1.0, -1e-9, 1e-9, 60.0, -60.0]]))
REFERENCE = {
    ReLU(): lambda z: z * (z > 0),
    LeakyReLU(0.3): lambda z: np.where(z < 0, 0.3 * z, z),
    Saturation(): lambda z: np.clip(z, -1, 1),
    Tanh(): lambda z: (np.exp(z) - np.exp(-z)) / (np.exp(z) + np.exp(-z)),
    CenteredLogistic(): lambda z: 1 / (1 + np.exp(-z)) - 0.5,
    Logistic(): lambda z: 1 / (1 + np.exp(-z)),
    Identity(): lambda z: z,
}


@pytest.mark.parametrize("phi", REFERENCE, ids=repr)
def test_the_formula_is_the_textbook_one(phi):
    np.testing.assert_allclose(phi(GRID), REFERENCE[phi](GRID), atol=1e-14)


@pytest.mark.parametrize("phi", ALL, ids=repr)
def test_numpy_and_casadi_read_the_same_formula(phi):
    z = casadi.SX.sym("z")
    graph = casadi.Function("phi", [z], [phi.formula(z, casadi)])
    np.testing.assert_allclose([float(graph(r)) for r in GRID], phi(GRID), atol=1e-14)


@pytest.mark.parametrize("phi", ALL, ids=repr)
def test_slopes_between_any_two_points_stay_in_the_stated_range_and_reach_its_ends(phi):
    r, s = np.meshgrid(GRID, GRID)
    far = np.abs(r - s) > 1e-6
    quotient = (phi(r) - phi(s))[far] / (r - s)[far]
    low, high = phi.slopes
    assert quotient.min() >= low - 1e-9 and quotient.max() <= high + 1e-9
    assert quotient.min() <= low + 1e-3 and quotient.max() >= high - 1e-3


@pytest.mark.parametrize("phi", [phi for phi in ALL if phi.sector is not None], ids=repr)
def test_the_sector_holds_with_phi_of_zero_zero(phi):
    low, high = phi.sector
    value = phi(GRID)
    assert phi(0.0) == 0.0
    assert np.min((value - low * GRID) * (high * GRID - value)) >= -1e-12


def test_the_plain_logistic_has_no_sector_at_the_origin():
    assert Logistic().sector is None and Logistic()(0.0) == 0.5
    assert sectors((ReLU(), Logistic())) is None


@pytest.mark.parametrize("phi", ALL, ids=repr)
def test_bounds_and_oddness_are_true(phi):
    low, high = phi.bounds
    assert phi(GRID).min() >= low and phi(GRID).max() <= high
    gap = np.max(np.abs(phi(-GRID) + phi(GRID)))
    assert gap < 1e-14 if phi.odd else gap > 0.1


@pytest.mark.parametrize("phi", [phi for phi in ALL if phi.pieces is not None], ids=repr)
def test_pieces_reproduce_the_function_and_agree_at_kinks_from_both_sides(phi):
    pieces = phi.pieces
    index = pieces.index(GRID)
    np.testing.assert_allclose(pieces.slopes[index] * GRID + pieces.intercepts[index], phi(GRID), atol=1e-15)
    left = pieces.slopes[:-1] * pieces.kinks + pieces.intercepts[:-1]
    right = pieces.slopes[1:] * pieces.kinks + pieces.intercepts[1:]
    np.testing.assert_array_equal(left, right)
    assert phi.slopes == (pieces.slopes.min(), pieces.slopes.max())


@pytest.mark.parametrize("phi", ALL, ids=repr)
def test_derivative_matches_differences_away_from_kinks(phi):
    z = np.array([-2.7, -0.6, 0.4, 3.1])
    np.testing.assert_allclose(phi.derivative(z), (phi(z + 1e-6) - phi(z - 1e-6)) / 2e-6, atol=1e-8)


def test_homogeneity_is_derived_from_the_pieces_only():
    assert ReLU().homogeneous == (0.0, 1.0)
    assert LeakyReLU(0.3).homogeneous == (0.3, 1.0)
    assert Identity().homogeneous == (1.0, 1.0)
    assert Saturation().homogeneous is None and Tanh().homogeneous is None


def test_units_mix_and_wrong_ones_are_refused():
    units = as_units([ReLU(), Tanh(), Saturation()], 3)
    z = np.array([[-1.0, 2.0], [0.5, -0.5], [4.0, 0.1]])
    np.testing.assert_allclose(evaluate(units, z), [[0, 2], np.tanh([0.5, -0.5]), [1, 0.1]])
    assert lipschitz((ReLU(), Logistic())).tolist() == [1.0, 0.25]
    with pytest.raises(DimensionError, match="3 entries.*2 hidden units"):
        as_units(units, 2)
    with pytest.raises(InvalidInputError, match="must be an Activation"):
        as_units(["relu"], 1)
    with pytest.raises(InvalidInputError, match="leaky ReLU slope = 1.5 is outside"):
        LeakyReLU(1.5)
