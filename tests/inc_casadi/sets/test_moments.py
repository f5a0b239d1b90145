"""A distribution known by support and two moments: what is possible is taken, what is not is refused, nothing is made up."""

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Moments, Polytope, Uniform
from inc_casadi.errors import DimensionError, InvalidInputError

P = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.2], [0.1, -0.2, 3.0]])
CORNERS = np.array([[0.0, 2.0, 0.0, 0.3, 1.0], [0.0, 0.1, 1.5, 0.2, 1.0], [0.0, 0.0, 0.2, 3.0, 1.0]])
SETS = {"box": Box([-1.0, 0.5, 2.0], [0.3, 1.5, 7.0]), "polytope": Polytope.from_vertices(CORNERS),
        "ellipsoid": Ellipsoid(P, [1.0, -2.0, 0.5], level=2.5)}
EVERY = pytest.mark.parametrize("support", SETS.values(), ids=SETS)


@EVERY
@pytest.mark.parametrize("seed", range(5))
def test_the_moments_of_any_points_of_the_support_are_taken(support, seed):
    rng = np.random.default_rng(seed)
    points, weights = support.sample(1 + 2 * seed, rng), rng.dirichlet(np.ones(1 + 2 * seed))
    if seed == 4 and not isinstance(support, Ellipsoid):
        points, weights = support.vertices, rng.dirichlet(np.ones(support.vertices.shape[1]))
    mean = points @ weights
    covariance = ((points - mean[:, None]) * weights) @ (points - mean[:, None]).T
    known = Moments(support, mean, covariance)
    np.testing.assert_allclose(known.second_moment, (points * weights) @ points.T, rtol=1e-12, atol=1e-12)
    assert known.dimension == 3 and known.support is support
    assert not known.mean.flags.writeable and not known.covariance.flags.writeable


def test_the_most_that_an_interval_allows_is_all_mass_at_its_ends():
    Moments(Box(-1, 3), [0.0], [[3.0]])  # (3 - 0) (0 + 1)
    with pytest.raises(InvalidInputError, match="covariance is larger.*E s_i s_j = -0.001"):
        Moments(Box(-1, 3), [0.0], [[3.001]])


def test_the_most_that_a_disc_allows_is_all_mass_on_its_circle():
    Moments(Ellipsoid(np.eye(2)), [0.6, 0.0], [[0.24, 0.0], [0.0, 0.4]])
    with pytest.raises(InvalidInputError, match="1.001 times the level"):
        Moments(Ellipsoid(np.eye(2)), [0.6, 0.0], [[0.24, 0.0], [0.0, 0.401]])


def test_a_slanted_half_space_counts():
    triangle = Polytope([[-1, 0], [0, -1], [1, 1]], [0, 0, 1])
    with pytest.raises(InvalidInputError, match="covariance is larger"):  # x y >= 0 and E x y = 1/9 - 0.12
        Moments(triangle, [1 / 3, 1 / 3], [[0.15, -0.12], [-0.12, 0.15]])
    Moments(triangle, [1 / 3, 1 / 3], [[2 / 9, -1 / 9], [-1 / 9, 2 / 9]])  # a third of the mass at each vertex


@EVERY
def test_the_mean_must_be_inside(support):
    with pytest.raises(InvalidInputError, match="mean is outside the support"):
        Moments(support, support.center + [0.0, 3.0, 0.0], 1e-3 * np.eye(3))


def test_what_is_not_known_is_not_made_up():
    known = Moments(SETS["box"], SETS["box"].center, 0.01 * np.eye(3))
    for ask in (lambda: known.sample(3, np.random.default_rng(0)), lambda: known.quadrature(2)):
        with pytest.raises(InvalidInputError, match="only its support, mean and covariance are known"):
            ask()
    np.testing.assert_array_equal(known.vertices, SETS["box"].vertices)


def test_bad_input_is_refused_at_the_door():
    box = SETS["box"]
    with pytest.raises(InvalidInputError, match="support must be a Box, Polytope or Ellipsoid, not Uniform"):
        Moments(Uniform(box), box.center, 0.01 * np.eye(3))
    with pytest.raises(InvalidInputError, match="covariance must be positive semidefinite"):
        Moments(box, box.center, -0.01 * np.eye(3))
    with pytest.raises(InvalidInputError, match="covariance is not symmetric"):
        Moments(box, box.center, 0.01 * np.eye(3) + 0.001 * np.eye(3, k=1))
    with pytest.raises(DimensionError, match="mean has shape"):
        Moments(box, [0.0], 0.01 * np.eye(3))
    with pytest.raises(DimensionError, match="covariance has shape"):
        Moments(box, box.center, np.eye(2))
    with pytest.raises(InvalidInputError, match="NaN"):
        Moments(box, [np.nan, 1.0, 3.0], np.eye(3))
