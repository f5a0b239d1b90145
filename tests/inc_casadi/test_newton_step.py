"""One interior-point step: the equations it solves and how far it goes."""

import numpy as np
import pytest
from lmi_draws import feasible

from inc_casadi.cone_program import normalized
from inc_casadi.interior_point import solve
from inc_casadi.newton_step import Iterate, advance, inner, reach, roots


def test_a_step_keeps_the_equations_of_the_method():
    """Newton steps bring <A_e, X> to cost_e, whatever X was before, and S stays the slack at y."""
    drawn = feasible(np.random.default_rng(2), bounds=3)
    program = normalized(drawn)
    y = solve(drawn, tolerance=1e-1).interior / program.unknowns
    S = program.slack(y)
    X = tuple(np.linalg.inv(s) if s.ndim == 2 else 1.0 / s for s in S)
    at, before = Iterate(y, S, X, True), program.cost - program.adjoint(X)
    for _ in range(6):
        at, _ = advance(program, at)
        for part, again in zip(at.S, program.slack(at.y), strict=True):
            np.testing.assert_array_equal(part, again)
    after = program.cost - program.adjoint(at.X)
    assert np.max(np.abs(after)) < 1e-6 * np.max(np.abs(before))
    gap = program.cost @ at.y + inner(program.constants, at.X)
    assert gap == pytest.approx(inner(at.X, at.S) + after @ at.y, abs=1e-9)


def test_the_reach_is_where_the_cone_ends():
    rng = np.random.default_rng(0)
    M = rng.normal(size=(4, 4))
    S, D = (M @ M.T + np.eye(4), np.array([1.0, 2.0])), (M + M.T - 5 * np.eye(4), np.array([1.0, -0.1]))
    a = reach(roots(S), D)
    assert np.linalg.eigvalsh(S[0] + a * D[0])[0] == pytest.approx(0.0, abs=1e-12)
    assert reach(roots(S), (np.eye(4), np.array([1.0, -20.0]))) == pytest.approx(0.1)
    assert reach(roots(S), (np.eye(4), np.ones(2))) == np.inf
