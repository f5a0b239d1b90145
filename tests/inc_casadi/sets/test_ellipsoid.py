"""The ellipsoid: by hand on the axes, and as the affine image of a ball."""

import numpy as np
import pytest

from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.sets import Ellipsoid

P = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, -0.2], [0.1, -0.2, 3.0]])
CENTER = np.array([1.0, -2.0, 0.5])
EGG = Ellipsoid(P, CENTER, level=2.5)


def boundary(count, seed):
    """Points with (x - c)' P (x - c) = level, by scaling directions: no root of P."""
    d = np.random.default_rng(seed).standard_normal((3, count))
    return CENTER[:, None] + d * np.sqrt(2.5 / np.einsum("in,ij,jn->n", d, P, d))


@pytest.mark.parametrize(("axes", "volume"), [
    ([2.0], 4.0), ([2.0, 3.0], 6 * np.pi), ([2.0, 3.0, 0.5], 4 * np.pi), ([1.0, 1.0, 1.0, 1.0], np.pi**2 / 2),
])
def test_volume_by_hand(axes, volume):
    assert Ellipsoid(np.diag(1 / np.array(axes) ** 2)).volume == pytest.approx(volume, rel=1e-12)


def test_the_level_scales_the_axes_by_its_root():
    assert EGG.volume == pytest.approx(2.5**1.5 * Ellipsoid(P).volume, rel=1e-12)
    assert Ellipsoid(P / 2.5, CENTER).volume == pytest.approx(EGG.volume, rel=1e-12)


def test_membership_changes_at_the_boundary():
    edge = boundary(200, 1) - CENTER[:, None]
    assert np.all(EGG.contains(CENTER[:, None] + (1 - 1e-9) * edge))
    assert not np.any(EGG.contains(CENTER[:, None] + (1 + 1e-9) * edge))
    assert np.all(EGG.contains(CENTER[:, None] + (1 + 1e-9) * edge, tol=3e-9))
    assert EGG.contains(CENTER) is True and EGG.contains(CENTER + 9) is False


def test_support_is_the_largest_value_on_the_boundary():
    directions = np.random.default_rng(2).standard_normal((3, 5))
    values = directions.T @ boundary(400_000, 3)
    support = EGG.support(directions)
    assert np.all(values <= support[:, None] * (1 + 1e-12) + 1e-12)
    np.testing.assert_allclose(values.max(axis=1), support, rtol=2e-3)
    assert EGG.support(directions[:, 0]) == pytest.approx(support[0]) and isinstance(EGG.support([1, 0, 0]), float)


def test_support_on_an_axis_by_hand():
    assert Ellipsoid(np.diag([4.0, 1.0]), [1.0, 0.0], level=9.0).support([2.0, 0.0]) == pytest.approx(2 * (1.0 + 1.5))


def test_the_origin_is_the_default_center():
    assert Ellipsoid(P).center.tolist() == [0.0, 0.0, 0.0] and Ellipsoid(P).level == 1.0
    assert Ellipsoid(4.0).dimension == 1


@pytest.mark.parametrize(("arguments", "error", "message"), [
    ((P + np.eye(3, k=1),), InvalidInputError, "P is not symmetric"),
    ((np.diag([1.0, 0.0]),), InvalidInputError, "P must be positive definite"),
    ((np.diag([1.0, -2.0]),), InvalidInputError, "smallest eigenvalue is -2"),
    ((P[:2],), DimensionError, "P has shape"),
    ((np.zeros((0, 0)),), DimensionError, "at least one coordinate"),
    ((P, [1.0, 2.0]), DimensionError, "center has shape"),
    ((P, CENTER * np.nan), InvalidInputError, "center holds a NaN"),
    ((P, CENTER, 0.0), InvalidInputError, "level = 0"),
    ((P, CENTER, -1.0), InvalidInputError, "level = -1"),
    ((np.full((3, 3), np.inf),), InvalidInputError, "P holds"),
])
def test_a_bad_ellipsoid_is_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        Ellipsoid(*arguments)


def test_an_ellipsoid_has_no_vertices():
    with pytest.raises(InvalidInputError, match="no vertices"):
        EGG.vertices  # noqa: B018
