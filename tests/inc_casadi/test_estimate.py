"""Simulation against closed forms, and its honesty about motions that do not end."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Empirical, Plant, Spec
from inc_casadi.estimate import estimate


def test_mean_and_error_of_a_scalar_loop():
    spec = Spec([[1.0]], [[2.0]], 0.9, Box([-1.0], [1.0]))
    run = estimate(Plant([[1.5]], [[1.0]]), INC.linear([[-1.0]]), spec, seed=3)
    exact = (1 + 2) / 3 / (1 - 0.9 / 4)
    assert abs(run.mean - exact) < 4 * run.standard_error and run.settled
    # x0^2 of a uniform variable has the variance 4/45
    assert run.standard_error == pytest.approx(3 * exact * np.sqrt(4 / 45 / run.samples), rel=0.05)
    assert run.largest <= 3 * exact


def test_same_seed_same_numbers():
    spec = Spec([[1.0]], [[2.0]], 0.9, Box([-1.0], [1.0]))
    runs = [estimate(Plant([[1.5]], [[1.0]]), INC.linear([[-1.0]]), spec, seed=s).mean for s in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


def test_divergence_and_motions_that_never_rest_are_told():
    spec = Spec([[1.0]], [[0.0]], 0.5, Box([-1.0], [1.0]))
    assert estimate(Plant([[1.5]], [[1.0]]), INC.linear([[0.5]]), spec).mean == np.inf
    turning = Plant([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]])
    run = estimate(turning, INC.linear([[0.0, 0.0]]), Spec(np.eye(2), [[1.0]], 0.9, Empirical([[1.0], [0.0]])))
    assert run.mean == pytest.approx(10.0) and not run.settled


def test_excess_over_a_limit_is_the_largest_seen():
    spec = Spec([[1.0]], [[0.0]], 0.9, Empirical([[1.0, -0.2]]), Box([-1.0], [0.5]))
    assert estimate(Plant([[1.5]], [[1.0]]), INC.linear([[-1.25]]), spec).excess == pytest.approx(0.25)
