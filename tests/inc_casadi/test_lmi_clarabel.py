"""Clarabel's direct binding against the interior-point solver: two programs that share no algorithm."""

import sys

import numpy as np
import pytest
from lmi_draws import feasible, loop, matrices, terms

from inc_casadi import interior_point, lmi_clarabel
from inc_casadi.errors import SolverError
from inc_casadi.lmi_problem import Block, Problem
from inc_casadi.schur import coefficients

AGREE = 1e-5  # of two objectives whose gaps are 1e-8 in scaled numbers


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", [{}, {"rows": 0, "bounds": 0}, {"spread": 2.0}, {"depth": 1e-2}, {"box": 20.0}])
def test_both_solvers_find_the_same_optimum(kind, seed):
    drawn = feasible(np.random.default_rng(10 + seed), **kind)
    mine, other = interior_point.solve(drawn), lmi_clarabel.solve(drawn)
    assert mine.status == "optimal" and other.status in ("optimal", "stalled")
    size = abs(drawn.cost @ mine.y)
    assert drawn.cost @ other.y == pytest.approx(drawn.cost @ mine.y, abs=AGREE * size)
    assert other.interior is None and other.iterations > 0


@pytest.mark.parametrize("radius, gain", [(0.8, 0.1), (0.9, 0.3), (0.99, 1.0), (0.7, 1.0)])
def test_both_solvers_agree_on_whether_a_loop_can_be_certified(radius, gain):
    for seed in range(3):
        drawn = loop(np.random.default_rng(seed), radius=radius, gain=gain, discount=1.0)
        mine, other = interior_point.solve(drawn), lmi_clarabel.solve(drawn)
        assert mine.status == other.status
        if mine.status == "optimal":
            assert drawn.cost @ other.y == pytest.approx(drawn.cost @ mine.y, rel=AGREE)


def test_columns_are_those_of_the_explicit_matrices(monkeypatch):
    some, size = terms(np.random.default_rng(0), 5)
    block = Block(np.zeros((5, 5)), some)
    expected = np.array([lmi_clarabel.svec(A) for A in matrices(block, size)]).T
    np.testing.assert_allclose(lmi_clarabel.svec_columns(coefficients(block, size)).toarray(), expected, atol=1e-12)
    monkeypatch.setattr(lmi_clarabel, "BATCH", 30)
    np.testing.assert_allclose(lmi_clarabel.svec_columns(coefficients(block, size)).toarray(), expected, atol=1e-12)


def test_svec_keeps_inner_products():
    M, N = (A + A.T for A in np.random.default_rng(1).normal(size=(2, 4, 4)))
    assert lmi_clarabel.svec(M) @ lmi_clarabel.svec(N) == pytest.approx(np.vdot(M, N))


def test_tiny_sizes():
    none = np.zeros(0)
    assert lmi_clarabel.solve(Problem(none, (), np.zeros((0, 0)), none, none, none)).status == "optimal"
    drawn = Problem(np.ones(1), (Block(np.zeros((0, 0)), ()),), np.zeros((0, 1)), none, np.array([2.0]), np.array([np.inf]))
    assert lmi_clarabel.solve(drawn).y[0] == pytest.approx(2.0, rel=1e-6)


def test_a_missing_clarabel_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(SolverError, match="pip install clarabel"):
        lmi_clarabel.solve(feasible(np.random.default_rng(0)))
