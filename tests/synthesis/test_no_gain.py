"""No stabilizing gain: the exact decision against a fine sweep of gains, and by hand."""

import numpy as np
import pytest

from inc_casadi import Plant
from synthesis.no_gain import _between, no_stabilizing_gain


def least_radius(plant):
    """The smallest spectral radius over a fine sweep of gains."""
    sizes = np.logspace(-4, 3, 3000)
    gains = np.concatenate([-sizes, [0.0], sizes])[:, None, None]
    return np.abs(np.linalg.eigvals(plant.A + gains * (plant.B @ plant.C))).max(axis=1).min()


def test_it_agrees_with_a_sweep_of_gains():
    rng, answers = np.random.default_rng(1), []
    for _ in range(60):
        n = rng.integers(1, 5)
        A = rng.normal(size=(n, n))
        A *= rng.uniform(0.8, 2.0) / np.max(np.abs(np.linalg.eigvals(A)))
        plant = Plant(A, rng.normal(size=(n, 1)), rng.normal(size=(1, n)))
        answers.append(no_stabilizing_gain(plant) == "")
        assert answers[-1] == (least_radius(plant) < 1 - 1e-6)
    assert 10 < sum(answers) < 50


@pytest.mark.parametrize(("A", "B", "C", "exists"), [
    ([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]], False),   # det < 1 asks f > 0, p(1) > 0 asks f < 0
    ([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.4]], False),   # det = 1 + 0.1 f
    ([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.6]], True),    # det = 1 - 0.1 f'  with f' = -f
    ([[2.0, 0.0], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 1.0]], False),   # the unstable mode is not reached: q_0 has no zero
    ([[1.0, 0.0], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 1.0]], False),   # p(1) = 0 for every f
    ([[0.0, 1.0], [-1.0, 0.0]], [[1.0], [0.0]], [[1.0, 0.0]], False),  # det = 1 for every f: trace only
    ([[0.5]], [[0.0]], [[1.0]], True), ([[-2.0]], [[1e-9]], [[1.0]], True),
])
def test_cases_by_hand(A, B, C, exists):
    assert (no_stabilizing_gain(Plant(A, B, C)) == "") is exists


@pytest.mark.parametrize("roots", [[0, 0, 1], [-3, 0, 0, 0, 2], [1, 1], [-2, -1, 4, 4], [0]])
def test_every_gap_between_roots_gets_a_point_multiple_roots_too(roots):
    points = _between([[-root, 1] for root in roots])
    distinct = sorted(set(roots))
    assert len(points) == len(distinct) + 1
    assert all(left < root < right for left, root, right in zip(points[:-1], distinct, points[1:], strict=True))


def test_what_it_does_not_decide_is_left_open():
    two = Plant(2 * np.eye(2), np.eye(2))
    assert no_stabilizing_gain(two) == "" == no_stabilizing_gain(Plant([[1.0]], [[0.0]], dt=0.0))
