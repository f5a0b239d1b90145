"""Farkas proofs in Fractions: right on both sides of the edge, and never more than the half-spaces allow."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import Polytope, implied
from inc_casadi.blocks import exact
from inc_casadi.implied import is_implied, unproved
from inc_casadi.linear_program import Optimum

SQUARE = np.vstack([np.eye(2), -np.eye(2)])


@pytest.mark.parametrize("seed, n", [(0, 2), (1, 3), (2, 5)])
def test_the_support_of_a_random_polytope_is_the_edge(seed, n):
    rng = np.random.default_rng(seed)
    H = rng.normal(size=(n + 4, n))
    H = np.vstack([H, -H.sum(axis=0)])
    polytope = Polytope(H, rng.uniform(0.5, 2.0, size=len(H)))
    rows = rng.normal(size=(10, n))
    support = polytope.support(rows.T)
    assert is_implied(polytope.H, polytope.h, rows, support * (1 + 1e-9))
    for row, value in zip(rows, support, strict=True):
        assert not is_implied(polytope.H, polytope.h, row[None], np.array([value * (1 - 1e-9)]))


def test_the_edge_itself_in_fractions():
    rows = exact(np.array([[1.0, 1.0]]))
    assert is_implied(SQUARE, np.ones(4), rows, exact(np.array([2.0])))
    assert not is_implied(SQUARE, np.ones(4), rows, np.array([Fraction(2) - Fraction(1, 10**40)], dtype=object))


def test_four_half_spaces_through_one_vertex():
    # At (1, 1) five rows meet, with multipliers that need not be unique.
    G = np.vstack([SQUARE, [[1.0, 1.0], [1.0, 2.0], [2.0, 1.0]]])
    g = np.array([1.0, 1.0, 1.0, 1.0, 2.0, 3.0, 3.0])
    assert is_implied(G, g, np.array([[3.0, 4.0]]), np.array([7.0]))
    assert is_implied(G, g, np.array([[0.3, 0.7]]), np.array([1.0 + 1e-9]))
    assert not is_implied(G, g, np.array([[0.3, 0.7]]), np.array([1.0 - 1e-9]))


def test_sizes_far_from_one():
    G, g = SQUARE * np.array([1e-6, 1e4]), 1e3 * np.ones(4)  # |x1| <= 1e9, |x2| <= 0.1
    assert is_implied(G, g, np.array([[1.0, 1.0]]), np.array([1e9 * (1 + 1e-9)]))
    assert not is_implied(G, g, np.array([[1.0, 0.0]]), np.array([1e9 * (1 - 1e-9)]))


def test_a_wrong_proposal_proves_nothing(monkeypatch):
    # y = (0, 1) stands for -x <= 1; the repair must take -1 there to get x, and y'g = -1 would "prove" x <= -1.
    wrong = Optimum(1.0, np.ones(1), np.array([0.0, 1.0]))
    monkeypatch.setattr(implied, "maximum", lambda row, G, g: wrong)
    assert not is_implied(np.array([[1.0], [-1.0]]), np.ones(2), np.ones((1, 1)), -np.ones(1))


def test_zero_rows_and_half_spaces_that_do_not_bound():
    assert is_implied(SQUARE, np.ones(4), np.zeros((1, 2)), np.zeros(1))
    assert unproved(SQUARE, np.ones(4), np.zeros((2, 2)), np.array([0.0, -1e-300])) == 1
    strip = np.array([[1.0, 0.0], [-1.0, 0.0]])
    assert not is_implied(strip, np.ones(2), np.array([[1.0, 1.0]]), np.array([100.0]))
