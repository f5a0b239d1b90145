"""The affine reading: every operation is the plain computation at every y, and a block is the symmetrized congruence."""

import numpy as np
import pytest

from inc_casadi.affine import Affine, index_of
from inc_casadi.blocks import diag, he
from inc_casadi.errors import InvalidInputError
from inc_casadi.multipliers import Unknown

UNKNOWNS = (
    Unknown("S", (3, 3), "symmetric"), Unknown("v", (3,), "nonnegative"), Unknown("G", (2, 3), "free"),
    Unknown("Z", (3, 3), "symmetric_nonnegative", zero=np.array([[1, 0, 1], [0, 0, 0], [1, 0, 0]], bool)),
    Unknown("H", (2, 2), "free", zero=np.array([[0, 1], [0, 0]], bool)), Unknown("one", (1,), "nonnegative"),
)
PLACES, SIZE = index_of(UNKNOWNS)


def plain(y):
    """The unknowns as arrays, from their places."""
    return {name: np.where(index >= 0, y[index], 0.0) for name, index in PLACES.items()}


def affine():
    return {name: Affine.unknown(index) for name, index in PLACES.items()}


def test_places_are_a_partition_and_symmetric_where_they_should_be():
    assert SIZE == 6 + 3 + 6 + 4 + 3 + 1
    used = np.concatenate([np.unique(index[index >= 0]) for index in PLACES.values()])
    assert sorted(used) == list(range(SIZE))
    for unknown in UNKNOWNS:
        index = PLACES[unknown.name]
        np.testing.assert_array_equal(index < 0, ~unknown.free)
        if unknown.is_symmetric:
            np.testing.assert_array_equal(index, index.T)
        assert affine()[unknown.name].shape == unknown.shape


def formulas(rng):
    """Formulas in the unknowns, one for each operation and then of several; every one reads arrays and Affine alike."""
    L, R, C, K = rng.normal(size=(4, 3)), rng.normal(size=(3, 5)), rng.normal(size=(3, 3)), rng.normal(size=(2, 4))
    G0, c = rng.normal(size=(2, 3)), float(rng.normal())
    return {
        "itself": lambda v: v["S"] + np.zeros((3, 3)), "left": lambda v: L @ v["S"], "right": lambda v: v["S"] @ R,
        "both": lambda v: L @ v["G"].T @ K, "transpose": lambda v: v["G"].T, "diag": lambda v: diag(v["v"]),
        "plus": lambda v: v["S"] + v["Z"], "plus array": lambda v: v["S"] + C, "array plus": lambda v: C + v["S"],
        "minus": lambda v: v["S"] - v["Z"], "minus array": lambda v: v["S"] - C, "array minus": lambda v: C - v["S"],
        "negative": lambda v: -v["G"], "times": lambda v: v["G"] * c, "number times": lambda v: c * v["G"],
        "zero times": lambda v: 0 * v["G"], "NumPy number times": lambda v: np.float64(c) * v["G"],
        "he": lambda v: he(C @ v["S"] - v["Z"]), "masked": lambda v: K.T @ v["H"] @ G0,
        "one": lambda v: np.ones((3, 1)) @ diag(v["one"]) @ np.ones((1, 3)),
        "sum": lambda v: sum(C[i:i + 1] @ v["S"] @ C[:, i:i + 1] for i in range(3)),
        "several": lambda v: he(L @ (c * v["S"] - diag(v["v"])) @ R[:, :4]) + (K.T @ (G0 - 2 * v["G"]) - L @ v["Z"]) @ L.T,
        "nested": lambda v: (L @ (v["S"] + C) - 2.0 * (L @ v["Z"])).T @ L + he(v["G"].T @ G0) + K[:, :3].T @ v["H"] @ G0,
    }


@pytest.mark.parametrize("name", sorted(formulas(np.random.default_rng(0))))
def test_every_operation_is_the_plain_computation(name):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        formula, y = formulas(rng)[name], rng.normal(size=SIZE)
        expected, read = formula(plain(y)), formula(affine())
        assert read.shape == expected.shape
        np.testing.assert_allclose(read.at(y), expected, atol=1e-12)
        np.testing.assert_allclose(read.T.at(y), expected.T, atol=1e-12)
        A, b = read.rows(SIZE)
        np.testing.assert_allclose(A @ y + b, expected.reshape(-1), atol=1e-12)
        if expected.shape[0] == expected.shape[1]:
            S = rng.normal(size=(expected.shape[0], 2))
            block = S.T @ expected @ S
            np.testing.assert_allclose(read.block(S).value(y), (block + block.T) / 2, atol=1e-11)


def test_terms_that_mirror_each_other_become_one():
    v, L, R = affine(), np.arange(6.0).reshape(2, 3), np.arange(6.0, 12.0).reshape(2, 3)
    pair = he(L @ v["G"].T @ np.eye(2)) - he(L @ v["S"] @ R.T)
    assert len(pair.terms) == 4 and len(pair.block(np.eye(2)).terms) == 2
    y = np.random.default_rng(2).normal(size=SIZE)
    np.testing.assert_allclose(pair.block(np.eye(2)).value(y), pair.at(y), atol=1e-12)
    twice = L @ v["S"] @ L.T + L @ v["S"] @ L.T + L @ v["S"] @ L.T  # a symmetric term mirrors itself
    np.testing.assert_allclose(twice.block(np.eye(2)).value(y), twice.at(y), atol=1e-12)


def test_it_stays_linear():
    v = affine()
    for product in (lambda: v["S"] @ v["S"], lambda: v["G"] @ v["S"], lambda: v["S"] * v["one"]):
        with pytest.raises(InvalidInputError, match="a product of two unknowns is not linear"):
            product()
    with pytest.raises(TypeError):
        np.diag(v["S"])  # only a vector has a diagonal matrix


def test_an_unknown_without_entries():
    empty = Affine.unknown(np.zeros((0,), int))
    nothing = np.zeros((2, 0)) @ diag(empty) @ np.zeros((0, 2))
    assert diag(empty).shape == (0, 0) and nothing.at(np.zeros(3)).shape == (2, 2)
