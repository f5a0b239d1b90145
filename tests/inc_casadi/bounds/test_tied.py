"""The ties as a recursion are those of the definition; steadied moves follow the motion found."""

import numpy as np
import pytest
from linear_draws import case

from inc_casadi import Plant
from inc_casadi.blocks import exact
from inc_casadi.bounds.moves import rollout
from inc_casadi.bounds.steadied import steadied
from inc_casadi.bounds.tied import hidden_states, ties_count, tying_forces
from inc_casadi.linear.regulator import discounted_lqr

A, B = [[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]]
ONE_OUTPUT = Plant(A, B, C=[[1.0, 0.0]])


def toeplitz(plant, T):
    """Y_k = sum_j T_j C A^(k-j) as the class is defined, (N, m, n)."""
    powers = [plant.C @ np.linalg.matrix_power(plant.A, k) for k in range(len(T))]
    return np.stack([sum(T[j] @ powers[k - j] for j in range(k + 1)) for k in range(len(T))])


@pytest.mark.parametrize("p", [1, 2])
def test_the_recursion_says_the_same_as_the_sums(p):
    plant, _ = case(5, n=4, m=2, p=p)
    rng = np.random.default_rng(0)
    Z = hidden_states(plant)
    assert Z.shape == (4, 4 - p) and np.all(exact(plant.C) @ Z == 0) and np.linalg.matrix_rank(Z.astype(float)) == 4 - p
    Y = toeplitz(plant, rng.standard_normal((5, 2, p)))
    before = np.concatenate([np.zeros((1, 2, 4)), Y[:-1]])
    assert np.max(np.abs((Y - before @ plant.A) @ Z.astype(float))) < 1e-12 * np.max(np.abs(Y))
    ties, other = rng.standard_normal((5, 2, 4 - p)), rng.standard_normal((5, 2, 4))
    forces = tying_forces(ties, Z.astype(float), plant.A)
    assert abs(np.sum(forces * Y)) < 1e-12 * np.sum(np.abs(forces * Y))
    shifted = np.concatenate([np.zeros((1, 2, 4)), other[:-1]])
    assert np.sum(forces * other) == pytest.approx(np.sum(ties * ((other - shifted @ plant.A) @ Z.astype(float))))
    assert np.all(tying_forces(exact(ties), Z, exact(plant.A)).astype(float).round(9) == forces.round(9))


def test_ties_count_only_where_they_restrict_and_can_be_used():
    cube = np.random.default_rng(0).standard_normal((2, 5))
    assert ties_count(ONE_OUTPUT, cube, 2) and not ties_count(ONE_OUTPUT, cube, 1)
    assert not ties_count(Plant(A, B, C=[[1.0, 1.0], [0.0, 1.0]]), cube, 2)
    assert not ties_count(ONE_OUTPUT, cube[:, :2], 2)


def test_steadied_moves_follow_the_motion_found():
    plant, spec = case(3, n=3, m=2, p=1, radius=2.0)
    gain, root = discounted_lqr(plant, spec)[0], np.eye(4)
    x, moves, motion = root[:-1], [], []
    for _ in range(30):
        moves.append(gain @ x)
        x = plant.A @ x + plant.B @ moves[-1]
        motion.append(x)
    off = 1e-9 * np.random.default_rng(0).standard_normal((30, 2, 4))
    far, near = (np.max(np.abs(rollout(plant.A, plant.B, root[:-1], each)[1:] - motion))
                 for each in (moves + off, steadied(plant, spec, root, moves + off, np.array(motion))))
    assert far > 1e-2 and near < 1e-7
