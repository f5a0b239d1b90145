"""Critical regions: against an interior-point solver, against all active sets tried one by one, and at their edges."""

from itertools import combinations

import draws
import numpy as np
import pytest

from inc_casadi import Box, Plant, Polytope
from inc_casadi.errors import EmptySetError, InfeasibleError
from inc_casadi.linear_program import maximum
from inc_casadi.mpc import MPC
from inc_casadi.pieces.critical_regions import CriticalRegions, feasible_set
from inc_casadi.pieces.regions import regions


def problem(seed, N=3, doubled=False):
    """Three states, two inputs, limits on both and on the last state; `doubled` lists every state limit twice."""
    rng = np.random.default_rng(seed)
    plant = draws.plant(rng, n=3, m=2, p=3, radius=1.15)
    H, h = np.vstack([np.eye(3), -np.eye(3)]), np.array([2.0, 2.5, 3.0, 1.5, 2.0, 2.5])
    states = Polytope(np.vstack([H, 2 * H]), np.append(h, 2 * h)) if doubled else Polytope(H, h)
    root = rng.normal(size=(3, 3))
    return MPC(Plant(plant.A, plant.B), root @ root.T, np.diag([0.5, 0.1]), N, Box([-1.0, -0.3], [0.5, 1.0]),
               states=states, terminal_set=Box([-1.0, -1.0, -1.0], [1.0, 1.2, 1.4]))


@pytest.mark.parametrize("seed, doubled", [(0, False), (1, False), (2, False), (0, True), (3, True)])
def test_the_law_is_the_first_input_of_the_solver(seed, doubled):
    mpc = problem(seed, doubled=doubled)
    law = CriticalRegions(mpc)
    x = feasible_set(mpc).sample(60, np.random.default_rng(seed))
    by_solver = np.column_stack([mpc.solve(point)[0] for point in x.T])
    np.testing.assert_allclose(law(x), by_solver, atol=2e-6)
    assert len(np.unique(law.patterns_at(x.T), axis=0)) > 5


def test_multipliers_and_slacks_satisfy_the_optimality_conditions():
    mpc = problem(4, doubled=True)
    law, program = CriticalRegions(mpc), mpc.condensed
    x = feasible_set(mpc).sample(40, np.random.default_rng(1))
    laws = law.laws(law.patterns_at(x.T))
    z = np.einsum("kqn,nk->kq", laws.Zx, x) + laws.z0
    moved = len(program.w)
    assert z.min() >= -1e-8
    scale = 1 / np.sqrt(np.diag(program.G @ np.linalg.solve(program.H, program.G.T)))
    for i, point in enumerate(x.T):
        multiplier = np.where(laws.patterns[i] == 1, z[i], 0.0)[:moved] * scale
        v = -np.linalg.solve(program.H, program.F @ point + program.G.T @ multiplier)
        slack = program.w + program.E @ point - program.G @ v
        assert slack.min() >= -1e-8 and np.abs(slack * multiplier).max() < 1e-8
        np.testing.assert_allclose(laws.Gx[i] @ point + laws.g[i], v[:2], atol=1e-9)


@pytest.mark.slow
def test_the_regions_are_those_of_all_active_sets_tried_one_by_one():
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.3], [1.0]])
    mpc = MPC(plant, np.diag([1.0, 0.3]), [[0.2]], 3, Box([-1.0], [0.8]), states=Box([-4.0, -3.0], [5.0, 1.5]))
    feasible = feasible_set(mpc)
    found = regions(plant, CriticalRegions(mpc), feasible)
    assert found.volumes.sum() == pytest.approx(feasible.volume, rel=1e-10)
    by_hand = _full_active_sets(mpc, feasible)
    assert {tuple(np.flatnonzero(pattern)) for pattern in found.patterns} == by_hand and len(by_hand) > 12


def _full_active_sets(mpc, feasible):
    """Active sets, by enumeration, whose critical region holds a ball of radius 1e-6."""
    program, full = mpc.condensed, set()
    H_F, H_G = np.linalg.solve(program.H, program.F), np.linalg.solve(program.H, program.G.T)
    for count in range(program.H.shape[0] + 1):
        for active in map(list, combinations(range(len(program.w)), count)):
            rows = program.G[active]
            gram = rows @ H_G[:, active]
            if np.linalg.matrix_rank(gram) < count:
                continue
            # multiplier = -gram^{-1} (w + (E + G H^{-1} F) x), v = -H^{-1} (F x + G' multiplier)
            L = -np.linalg.solve(gram, program.E[active] + rows @ H_F) if count else np.zeros((0, 2))
            l = -np.linalg.solve(gram, program.w[active]) if count else np.zeros(0)
            V, v = -H_F - H_G[:, active] @ L, -H_G[:, active] @ l
            others = np.setdiff1d(np.arange(len(program.w)), active)
            G = np.vstack([-L, program.G[others] @ V - program.E[others], feasible.H])
            g = np.concatenate([l, program.w[others] - program.G[others] @ v, feasible.h])
            size = np.linalg.norm(G, axis=1)
            ball = maximum(np.array([0.0, 0.0, 1.0]), np.column_stack([G, size]), g)
            if ball is not None and ball.value > 1e-6:
                full.add(tuple(active))
    return full


def test_without_state_limits_it_is_the_law_of_the_inc():
    mpc = problem(5)
    mpc = MPC(mpc.plant, mpc.Q, mpc.R, 3, mpc.inputs, discount=0.9)
    x = 10.0 ** np.random.default_rng(0).uniform(-1, 1, size=200) * np.random.default_rng(1).normal(size=(3, 200))
    np.testing.assert_allclose(CriticalRegions(mpc)(x), mpc.inc()(x), atol=1e-9)


def test_a_guess_is_corrected_and_a_good_one_kept():
    mpc = problem(0)
    law = CriticalRegions(mpc)
    x = feasible_set(mpc).sample(30, np.random.default_rng(3)).T
    patterns = law.patterns_at(x)
    np.testing.assert_array_equal(law.patterns_at(x, patterns), patterns)
    shuffled = law.patterns_at(x, patterns[::-1])
    laws = [law.laws(each) for each in (patterns, shuffled)]
    u = [np.einsum("kmn,kn->km", each.Gx, x) + each.g for each in laws]
    np.testing.assert_allclose(u[0], u[1], atol=1e-8)


def test_states_without_a_solution_are_refused():
    mpc = problem(1)
    law, feasible = CriticalRegions(mpc), feasible_set(mpc)
    inside, rng = 0, np.random.default_rng(0)
    for x in 1.2 * mpc.states.sample(40, rng).T:
        if abs(np.max(feasible.H @ x - feasible.h)) < 1e-6:
            continue
        if feasible.contains(x):
            inside += law(x[:, None]).shape == (2, 1)
        else:
            with pytest.raises(InfeasibleError):
                law(x[:, None])
    assert 0 < inside < 40
    with pytest.raises(InfeasibleError, match="no input can change"):
        law(np.array([[9.0], [0.0], [0.0]]))


def test_a_region_beyond_the_feasible_set_is_refused():
    mpc = problem(1)
    with pytest.raises(InfeasibleError):
        regions(mpc.plant, CriticalRegions(mpc), Box([-1.4] * 3, [1.9] * 3))


def test_the_feasible_set_by_hand_and_without_limits():
    # x+ = 2 x + u from |x| <= 1/2 backwards: (1/2 + 1) / 2 = 3/4, then 7/8.
    mpc = MPC(Plant([[2.0]], [[1.0]]), [[1.0]], [[1.0]], 2, Box([-1.0], [1.0]), terminal_set=Box([-0.5], [0.5]))
    np.testing.assert_allclose(np.sort(feasible_set(mpc).vertices[0]), [-0.875, 0.875], atol=1e-9)
    with pytest.raises(EmptySetError, match="unbounded"):
        feasible_set(MPC(Plant([[2.0]], [[1.0]]), [[1.0]], [[1.0]], 2, Box([-1.0], [1.0])))
