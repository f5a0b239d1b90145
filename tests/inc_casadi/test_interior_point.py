"""The interior-point solver against hand calculations, against duality, and at the edges."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from lmi_draws import feasible, loop, matrices, symmetric_index

from inc_casadi.errors import DimensionError
from inc_casadi.interior_point import View, _verdict, solve
from inc_casadi.lmi_problem import Block, Problem, Term
from inc_casadi.newton_step import Iterate

GAP = 1e-7  # of an objective at tolerance 1e-8, counting the last digits of the dual's residual


def problem(cost, blocks=(), rows=None, offset=(), lower=None, upper=None):
    v = len(cost)
    return Problem(np.array(cost, float), tuple(blocks), np.zeros((0, v)) if rows is None else np.array(rows, float),
                   np.array(offset, float), np.full(v, -np.inf) if lower is None else np.array(lower, float),
                   np.full(v, np.inf) if upper is None else np.array(upper, float))


def free_entry(constant):
    """The block [[y0, c], [c, y1]]."""
    return Block(np.array([[0.0, constant], [constant, 0.0]]), (Term(np.array([[0, -1], [-1, 1]]), np.eye(2), np.eye(2)),))


def norm_block(M, t):
    """t I - M as a block in the unknown t."""
    N = len(M)
    return Block(-M, (Term(np.where(np.eye(N) > 0, t, -1), np.eye(N), np.eye(N)),))


def test_least_eigenvalue_bound_by_hand():
    M = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 4.0]])
    found = solve(problem([1.0], [norm_block(M, 0)]))
    assert found.status == "optimal" and found.gap <= 1e-8
    np.testing.assert_allclose(found.y, np.linalg.eigvalsh(M)[-1:], rtol=1e-8)


def test_product_of_two_numbers_by_hand():
    found = solve(problem([9.0, 1.0], [free_entry(2.0)]))  # y0 y1 >= 4: 9 y0 + y1 >= 2 sqrt 36
    assert found.status == "optimal" and np.dot([9.0, 1.0], found.y) == pytest.approx(12.0, rel=GAP)


def test_a_linear_program_by_hand():
    found = solve(problem([-3.0, -5.0], rows=[[-1, 0], [0, -2], [-3, -2]], offset=[4, 12, 18], lower=[0, 0]))
    assert found.status == "optimal"
    np.testing.assert_allclose(found.y, [2.0, 6.0], rtol=1e-6)


def test_lyapunov_cost_of_a_linear_loop():
    rng = np.random.default_rng(3)
    n, A = 4, 0.4 * rng.normal(size=(4, 4))
    A *= 0.9 / np.max(np.abs(np.linalg.eigvals(A)))
    P, size = symmetric_index(n)
    decay = Block(-np.eye(n), (Term(P, np.eye(n), np.eye(n)), Term(P, -A.T, A.T)))
    cost = np.zeros(size)
    cost[np.diag(P)] = 1.0
    exact = np.linalg.solve(np.eye(n * n) - np.kron(A.T, A.T), np.eye(n).ravel())
    found = solve(problem(cost, [decay]))
    assert cost @ found.y == pytest.approx(np.trace(exact.reshape(n, n)), rel=GAP)


def test_an_optimum_at_a_box_and_far_boxes():
    near = solve(problem([-1.0, 1.0], [free_entry(2.0)], lower=[-1e6, -1e6], upper=[7.0, 1e6]))
    np.testing.assert_allclose(near.y, [7.0, 4.0 / 7.0], rtol=1e-6)
    far = solve(problem([-1.0], lower=[-1e6], upper=[1e6]))
    assert far.status == "optimal" and far.y[0] == pytest.approx(1e6, rel=1e-7) and far.y[0] < 1e6


def test_the_widest_margin_of_a_normalized_lyapunov_matrix():
    A = np.diag([0.5, 0.8])  # P - A'PA >= t I and trace P <= 1: both eigenvalues of the difference equal t
    P, t = symmetric_index(2)
    all_t = np.where(np.eye(2) > 0, t, -1)
    block = Block(np.zeros((2, 2)), (Term(P, np.eye(2), np.eye(2)), Term(P, -A.T, A.T), Term(all_t, -np.eye(2), np.eye(2))))
    found = solve(problem([0, 0, 0, -1.0], [block], rows=[[-1.0, 0, -1.0, 0]], offset=[1.0]))
    assert found.y[t] == pytest.approx(1.0 / (1 / 0.75 + 1 / 0.36), rel=GAP)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", [{}, {"rows": 0, "bounds": 0}, {"spread": 3.0}, {"depth": 1e-4}, {"box": 1e6}])
def test_random_problems_end_optimal_strictly_inside_and_obey_weak_duality(kind, seed):
    drawn = feasible(np.random.default_rng(seed), **kind)
    found = solve(drawn)
    assert found.status == "optimal" and found.gap <= 1e-8
    assert drawn.violation(found.y) < 0.0 and drawn.violation(found.interior) < 0.0
    assert drawn.cost @ found.interior > drawn.cost @ found.y  # deeper means dearer


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", [{"rows": 0, "bounds": 0}, {"rows": 0, "bounds": 0, "spread": 3.0}])
def test_the_multipliers_meet_the_optimality_conditions_of_the_problem_as_it_is_stated(kind, seed):
    drawn = feasible(np.random.default_rng(seed), **kind)
    found = solve(drawn, tolerance=1e-9)
    pairs = list(zip(drawn.blocks, found.X, strict=True))
    products = [np.einsum("eij,ij->e", matrices(block, drawn.size), X) for block, X in pairs]
    np.testing.assert_allclose(sum(products), drawn.cost, rtol=1e-5, atol=1e-7 * np.max(np.abs(drawn.cost)))
    complementary = sum(np.vdot(X, block.value(found.y)) for block, X in pairs)
    assert 0.0 <= complementary <= 1e-7 * np.abs(drawn.cost) @ np.abs(found.y) and found.residual <= 1e-6
    assert all(np.linalg.eigvalsh(X)[0] > 0.0 for X in found.X)


def test_the_depth_of_the_interior_point_is_chosen():
    drawn = feasible(np.random.default_rng(0))
    near, far = (solve(drawn, depth=depth) for depth in (1e-4, 1e-2))
    assert drawn.violation(far.interior) < drawn.violation(near.interior) < drawn.violation(near.y)
    np.testing.assert_array_equal(near.y, far.y)


def test_where_nothing_is_feasible_there_are_no_multipliers():
    found = solve(problem([1.0], rows=[[1.0], [-1.0]], offset=[-1.0, 0.5]))
    assert found.X == () and found.residual == np.inf


@pytest.mark.parametrize("seed", range(3))
def test_no_feasible_point_of_random_steps_is_cheaper(seed):
    rng = np.random.default_rng(seed)
    drawn = feasible(rng)
    found = solve(drawn)
    best, size = drawn.cost @ found.y, np.abs(drawn.cost) @ np.abs(found.y)
    for step in 10.0 ** rng.uniform(-6, 0, size=300):
        other = found.interior + step * rng.normal(size=drawn.size)
        if drawn.violation(other) < 0.0:
            assert drawn.cost @ other > best - 1e-8 * size


@pytest.mark.parametrize("n, q, radius", [(4, 8, 0.8), (3, 5, 0.99), (5, 20, 0.9), (2, 0, 0.9)])
def test_loops_of_the_typical_kind(n, q, radius):
    drawn = loop(np.random.default_rng(0), n, q, radius, gain=0.02)
    found = solve(drawn)
    assert found.status == "optimal" and drawn.violation(found.y) < 0.0 and found.iterations <= 25


@pytest.mark.parametrize("seed", range(4))
def test_loops_that_cannot_be_certified_are_infeasible(seed):
    found = solve(loop(np.random.default_rng(seed), radius=0.99, discount=1.0, gain=1.0))
    assert found.status == "infeasible" and found.interior is None


def test_infeasible_by_hand_even_when_the_cost_has_no_minimum():
    low = Block(np.array([[-1.0, 0.0], [0.0, -1.0]]), (Term(np.array([[-1, 0], [0, -1]]), np.eye(2), np.eye(2)),))
    assert solve(problem([0.0], [low])).status == "infeasible"  # the diagonal is negative whatever y is
    assert solve(problem([0.0, 1.0], [low], lower=[-np.inf, 0.0])).status == "infeasible"
    assert solve(problem([0.0, -1.0], [low], lower=[-np.inf, 0.0])).status == "infeasible"
    assert solve(problem([1.0], rows=[[1.0], [-1.0]], offset=[-1.0, 0.5])).status == "infeasible"


def test_a_cost_without_a_minimum_is_never_called_optimal():
    drawn = problem([-1.0, 0.0], [free_entry(1.0)])
    found = solve(drawn)
    assert found.status in ("stalled", "limit") and drawn.violation(found.y) < 0.0


def test_no_strict_interior_is_never_called_optimal():
    found = solve(problem([1.0, 1.0], rows=[[1.0, -1.0], [-1.0, 1.0]], offset=[0.0, 0.0], lower=[1.0, 1.0]))
    assert found.status in ("stalled", "limit")


def doubled(drawn, e):
    """The problem with one more unknown that enters everywhere as unknown e does: only their sum is determined."""
    blocks = tuple(replace(block, terms=block.terms + tuple(
        replace(term, index=np.where(term.index == e, drawn.size, -1)) for term in block.terms if e in term.index))
        for block in drawn.blocks)
    return Problem(np.r_[drawn.cost, drawn.cost[e]], blocks, np.c_[drawn.rows, drawn.rows[:, e]], drawn.offset,
                   np.r_[drawn.lower, -np.inf], np.r_[drawn.upper, np.inf])


@pytest.mark.parametrize("seed", range(3))
def test_redundant_and_idle_unknowns(seed):
    drawn = feasible(np.random.default_rng(seed), bounds=0)
    best = drawn.cost @ solve(drawn).y
    flat = doubled(drawn, 0)
    idle = Problem(np.r_[drawn.cost, 0.0], drawn.blocks, np.c_[drawn.rows, np.zeros(3)], drawn.offset,
                   np.r_[drawn.lower, -np.inf], np.r_[drawn.upper, np.inf])
    for more in (flat, idle):
        found = solve(more)
        assert found.status == "optimal" and more.violation(found.y) < 0.0
        assert more.cost @ found.y == pytest.approx(best, rel=GAP)


def test_a_feasibility_problem_without_cost():
    drawn = feasible(np.random.default_rng(6))
    found = solve(replace(drawn, cost=np.zeros(drawn.size)))
    assert found.status == "optimal" and drawn.violation(found.y) < 0.0


def test_warm_start_saves_iterations_and_an_unusable_one_is_ignored():
    drawn = loop(np.random.default_rng(0), 4, 8)
    cold = solve(drawn)
    nearby = replace(drawn, cost=drawn.cost + 0.01 * np.abs(np.random.default_rng(1).normal(size=drawn.size)))
    warm, again = solve(nearby, start=cold.interior), solve(nearby)
    assert warm.status == "optimal" and warm.iterations <= again.iterations // 2
    assert nearby.cost @ warm.y == pytest.approx(nearby.cost @ again.y, rel=GAP)
    ignored = solve(drawn, start=np.full(drawn.size, -1.0))
    np.testing.assert_array_equal(ignored.y, cold.y)
    with pytest.raises(DimensionError, match="start"):
        solve(drawn, start=np.ones(drawn.size + 1))


def test_stop_sees_strictly_feasible_points_only_and_ends_the_search():
    drawn, seen = feasible(np.random.default_rng(7)), []

    def enough(y):
        seen.append(y)
        return len(seen) == 3

    found = solve(drawn, stop=enough)
    assert found.status == "stopped" and len(seen) == 3 and all(drawn.violation(y) < 0.0 for y in seen)
    np.testing.assert_allclose(found.y, seen[-1], rtol=1e-12)
    never = solve(drawn, stop=lambda y: False)
    np.testing.assert_array_equal(never.y, solve(drawn).y)


def test_optimal_asks_for_a_small_gap_a_small_residual_and_a_feasible_point():
    at = Iterate(np.zeros(1), (np.ones(1),), (np.ones(1),), True)
    seen = View(gap=1e-9, residual=1e-9, infeasible=False)
    assert _verdict(at, seen, [], 1e-8) == "optimal"
    assert _verdict(replace(at, exact=False), seen, [], 1e-8) == ""
    assert _verdict(at, replace(seen, residual=1e-3), [], 1e-8) == _verdict(at, replace(seen, gap=1e-7), [], 1e-8) == ""


def test_the_iteration_limit_is_named_and_kept():
    found = solve(feasible(np.random.default_rng(8)), max_iterations=5)
    assert (found.status, found.iterations) == ("limit", 5)


def test_tiny_sizes():
    none = np.zeros((0, 0))
    assert solve(problem([])).status == "optimal"
    assert solve(problem([], [Block(np.eye(2), ())])).status == "optimal"
    assert solve(problem([], [Block(-np.eye(2), ())])).status == "infeasible"
    assert solve(problem([1.0])).status == "stalled" and solve(problem([0.0])).status == "optimal"
    found = solve(problem([1.0], [Block(none, ()), norm_block(np.eye(1), 0)]))
    assert found.status == "optimal" and found.y[0] == pytest.approx(1.0, rel=1e-8)


@pytest.mark.parametrize("scale", [1e-200, 1e200, np.nan])
def test_numerical_trouble_is_a_status_and_not_an_exception(scale):
    found = solve(problem([1.0, 1.0], [free_entry(scale)]))
    assert found.status in ("optimal", "stalled", "limit", "infeasible")
    assert found.status != "optimal" or np.isfinite(scale)


def test_importing_the_solver_loads_numpy_only():
    text = ("import sys, inc_casadi.interior_point, inc_casadi.lmi_clarabel;"
            "print('scipy' in sys.modules, 'clarabel' in sys.modules)")
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
