"""Values as JSON and back: arrays of every kind to the bit, numbers that are not finite, and what is no value."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Polytope, load, save
from inc_casadi.errors import FormatError


def again(noun, folder):
    save(noun, folder / "noun.json")
    return load(folder / "noun.json")


@pytest.mark.parametrize(
    "value",
    [
        np.array([[1, -2], [3, 2**60]]),
        np.array([True, False]),
        np.zeros((0, 3)),
        np.zeros((2, 0), dtype=int),
        np.array([[Fraction(1, 3), Fraction(-7)]], dtype=object),
        np.array([-0.0, 5e-324]),
        np.array(3.5),
    ],
)
def test_arrays_keep_type_shape_and_bits(value, tmp_path):
    back = again({"value": value}, tmp_path)["value"]
    assert back.dtype == value.dtype and back.shape == value.shape and not back.flags.writeable
    assert back.tobytes() == value.tobytes() if value.dtype != object else np.array_equal(back, value)


@pytest.mark.parametrize(
    "value",
    [np.inf, -np.inf, Fraction(22, 7), -0.0, 2**70, True, np.float64(1 / 3), np.int64(3), np.bool_(True), None, "words"],
)
def test_scalars_keep_their_value(value, tmp_path):
    back = again({"value": value}, tmp_path)["value"]
    assert back == value and str(back) == str(value)  # -0.0 too


def test_nan_comes_back(tmp_path):
    assert np.isnan(again({"value": np.nan}, tmp_path)["value"])


@pytest.mark.parametrize(
    "value",
    [np.array([np.nan]), np.array([np.inf]), np.array([1j]), np.array(["a"]), np.array([object()]), {1, 2}, object()],
)
def test_other_things_are_refused(value, tmp_path):
    with pytest.raises(FormatError, match="cannot be saved"):
        save({"value": value}, tmp_path / "x.json")
    assert not (tmp_path / "x.json").exists()


def test_the_hull_of_given_points_keeps_them(tmp_path):
    """Computed from half-spaces they would come back rounded, in another order, and costs with them."""
    points = np.random.default_rng(1).normal(size=(3, 8))
    hull = Polytope.from_vertices(points)
    back = again(hull, tmp_path)
    assert back.vertices.tobytes() == hull.vertices.tobytes() and back.simplices().tobytes() == hull.simplices().tobytes()
    assert (back.volume, back.H.tobytes()) == (hull.volume, hull.H.tobytes())


@pytest.mark.parametrize(
    "forge",
    [lambda v: 0.9 * v, lambda v: v[:, 1:], lambda v: v + 1e-6, lambda v: np.hstack([v, v.mean(axis=1, keepdims=True)])],
)
def test_points_that_are_not_of_the_half_spaces_are_refused(forge, tmp_path):
    square = Polytope.from_vertices(np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]]))
    square.__dict__["vertices"] = forge(square.vertices)
    save(square, tmp_path / "square.json")
    with pytest.raises(FormatError, match="vertices"):
        load(tmp_path / "square.json")
