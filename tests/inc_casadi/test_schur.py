"""The low-rank reading of coefficient matrices against the matrices formed explicitly."""

import numpy as np
import pytest
from lmi_draws import matrices, symmetric_index, terms

from inc_casadi import schur as rooms
from inc_casadi.lmi_problem import Block, Term
from inc_casadi.schur import coefficients, schur


def drawn(seed=0, N=7):
    rng = np.random.default_rng(seed)
    some, size = terms(rng, N)
    block = Block(np.zeros((N, N)), some)
    X, Z = (M @ M.T for M in rng.normal(size=(2, N, N)))
    return block, size, X, Z, rng.normal(size=size)


def all_pairs(N=40, n=6):
    """A block whose pairs of columns are many more than its columns."""
    P, size = symmetric_index(n)
    return Block(np.zeros((N, N)), (Term(P, *(np.random.default_rng(n).normal(size=(2, N, n)))),)), size


@pytest.mark.parametrize("block, size, few", [(*drawn(N=2)[:2], True), (*drawn(N=7)[:2], True), (*all_pairs(), False)])
def test_image_adjoint_and_schur_matrix_are_those_of_the_explicit_matrices(block, size, few):
    rng, N = np.random.default_rng(0), len(block.constant)
    X, Z = (M @ M.T for M in rng.normal(size=(2, N, N)))
    A, explicit, y = coefficients(block, size), matrices(block, size), rng.normal(size=size)
    assert A._few == few
    np.testing.assert_allclose(A.image(y), np.einsum("e,eij->ij", y, explicit), atol=1e-11)
    np.testing.assert_allclose(A.adjoint(X), np.einsum("eij,ij->e", explicit, X), rtol=1e-11, atol=1e-9)
    H = np.einsum("eij,jk,fkl,li->ef", explicit, X, explicit, Z, optimize=True)
    np.testing.assert_allclose(schur(A, A.gram(X), A.gram(Z)), H, rtol=1e-10, atol=1e-9 * np.max(np.abs(H)))


def test_small_patches_and_sparse_weights_change_nothing(monkeypatch):
    block, size, X, Z, y = drawn()
    A = coefficients(block, size)
    monkeypatch.setattr(rooms, "PATCH", 3 * A.a.size)
    monkeypatch.setattr(rooms, "NARROWEST", 1)
    monkeypatch.setattr(rooms, "DENSE", 0)
    B = coefficients(block, size)
    assert not isinstance(B.weights, np.ndarray)
    np.testing.assert_allclose(schur(B, B.gram(X), B.gram(Z)), schur(A, A.gram(X), A.gram(Z)), rtol=1e-12, atol=1e-12)
    scale = np.arange(1.0, size + 1)
    np.testing.assert_allclose(B.scaled(scale, 3.0).image(y), A.image(3.0 * scale * y), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(A.scaled(scale, 3.0).adjoint(X), 3.0 * scale * A.adjoint(X), rtol=1e-12)


def test_a_symmetric_unknown_between_multiples_of_one_factor_has_one_pair_per_unknown():
    rng = np.random.default_rng(1)
    P, size = symmetric_index(4)
    F = rng.normal(size=(9, 4))
    assert coefficients(Block(np.zeros((9, 9)), (Term(P, -0.95 * F, F),)), size).a.size == size
    assert coefficients(Block(np.zeros((9, 9)), (Term(P, F, F), Term(P, 3.0 * F, -F))), size).a.size == size
    assert coefficients(Block(np.zeros((9, 9)), (Term(P, F, rng.normal(size=(9, 4))),)), size).a.size == 16


def test_one_unknown_all_along_the_diagonal():
    index = np.where(np.eye(3) > 0, 1, -1)
    A = coefficients(Block(np.zeros((3, 3)), (Term(index, -np.eye(3), np.eye(3)),)), 2)
    np.testing.assert_array_equal(A.image(np.array([5.0, 2.0])), -2.0 * np.eye(3))
    np.testing.assert_array_equal(A.adjoint(np.diag([1.0, 2.0, 4.0])), [0.0, -7.0])


@pytest.mark.parametrize("block", [Block(np.zeros((0, 0)), ()), Block(np.eye(2), ()),
                                   Block(np.eye(2), (Term(np.array([[0]]), np.zeros((2, 1)), np.ones((2, 1))),)),
                                   Block(np.eye(2), (Term(np.zeros((0, 1), int), np.zeros((2, 0)), np.ones((2, 1))),))])
def test_blocks_that_no_unknown_moves(block):
    A, M = coefficients(block, 3), np.eye(len(block.constant))
    assert not np.any(A.image(np.ones(3))) and not np.any(A.adjoint(M)) and not np.any(schur(A, A.gram(M), A.gram(M)))
