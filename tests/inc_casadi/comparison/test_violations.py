"""Where linear loops exceed their limits: against motions from the vertices."""

from __future__ import annotations

import numpy as np
import pytest

from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from inc_casadi.comparison.violations import first_violation

RNG = np.random.default_rng(3)
F = np.array([[0.0, 1.3, 0.1], [-1.3, 0.1, 0.0], [0.2, 0.0, 0.5]])  # it turns and grows
G = np.array([[0.1, 0.03, -0.02], [0.0, 0.05, 0.01]])
LIMITS = Polytope([[1.0, 0.5], [-1.0, 0.2], [0.0, 1.0], [0.0, -1.0]], [0.6, 0.5, 0.4, 0.3])


def test_the_first_excess_is_that_of_the_motions_from_the_vertices():
    start = Uniform(Box([-1.0, -0.5, 0.0], [0.8, 0.5, 2.0]))
    moved = [np.linalg.matrix_power(F, k) @ start.vertices for k in range(50)]
    excess = np.array([np.max(LIMITS.H @ G @ z - LIMITS.h[:, None]) for z in moved])
    k = int(np.argmax(excess > 1e-9))
    over = excess[k]
    assert k > 1
    assert first_violation(LIMITS, start, F, G) == f"an input limit is exceeded by {over:.3g} at k = {k}"
    assert first_violation(LIMITS, start, F, G, steps=k) == ""


@pytest.mark.parametrize("start", [Empirical([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]), Uniform(Ellipsoid(np.eye(3)))])
def test_other_distributions(start):
    assert first_violation(Box([-0.11, -0.06], [0.11, 0.06]), start, 0 * F, G) == ""
    assert "at k = 0" in first_violation(Box([-0.09, -0.06], [0.09, 0.06]), start, 0 * F, G)


def test_unbounded_starts_and_no_limits():
    start = Gaussian(np.zeros(3), np.eye(3))
    assert first_violation(LIMITS, start, F, 0 * G) == "" and first_violation(None, start, F, G) == ""
    assert "unbounded" in first_violation(LIMITS, start, F, G)
