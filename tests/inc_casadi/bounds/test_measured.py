"""What moves may depend on: exact ranks, and bases that contain the row space."""

import numpy as np
import pytest

from inc_casadi import Plant
from inc_casadi.blocks import exact
from inc_casadi.bounds.measured import measured_rows, orthonormal

B = np.ones((4, 1))


def stack(plant, k):
    return np.vstack([plant.C @ np.linalg.matrix_power(plant.A, j) for j in range(k + 1)])


@pytest.mark.parametrize("seed", range(5))
def test_the_basis_spans_the_stack(seed):
    rng = np.random.default_rng(seed)
    plant = Plant(rng.integers(-2, 3, (4, 4)), B, C=rng.integers(-1, 2, (1 + seed % 2, 4)))
    for k, rows in enumerate(measured_rows(plant, 6)):
        rank = np.linalg.matrix_rank(stack(plant, k))
        assert rows.basis.shape == (rank, 4)
        np.testing.assert_allclose(rows.basis @ rows.basis.T, np.eye(rank), atol=1e-12)
        np.testing.assert_allclose(stack(plant, k) @ rows.basis.T @ rows.basis, stack(plant, k), atol=1e-8)
        assert 0 <= rows.sine < 1e-11


def test_a_direction_measured_ever_so_faintly_is_kept():
    A = np.diag([0.5, 0.25])
    A[0, 1] = 1e-30
    sizes = [rows.basis.shape[0] for rows in measured_rows(Plant(A, [[1.0], [1.0]], C=[[1.0, 0.0]]), 3)]
    assert sizes == [1, 2, 2]


def test_a_direction_that_is_never_measured_is_left_out():
    A = np.array([[0.3, 0.1, 0.0], [0.7, 0.9, 0.0], [1.0, 2.0, 3.0]])
    rows = measured_rows(Plant(A, np.ones((3, 1)), C=[[0.1, 0.2, 0.0]]), 30)
    assert [len(row.basis) for row in rows[:3]] == [1, 2, 2] and len(rows) == 30
    assert np.all(rows[-1].basis[:, 2] == 0)


def test_with_the_full_state_everything_is_seen_at_once():
    for rows in measured_rows(Plant(2 * np.eye(2), np.ones((2, 1))), 2):
        assert rows.basis.tolist() == np.eye(2).tolist() and rows.sine == 0


def test_measuring_nothing_leaves_constants_only():
    assert measured_rows(Plant(np.eye(2), np.ones((2, 1)), C=[[0.0, 0.0]]), 2)[1].basis.shape == (0, 2)


def test_a_badly_conditioned_basis_is_replaced_by_everything():
    rows = exact(np.array([[1.0, 0.0, 2.0], [1.0, 1e-11, 2.0]]))
    assert orthonormal(list(rows), 3).basis.tolist() == np.eye(3).tolist()
    assert orthonormal(list(exact(np.array([[1.0, 0.0, 2.0], [1.0, 1e-4, 2.0]]))), 3).sine > 1e-13
