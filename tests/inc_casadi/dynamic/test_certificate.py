"""Regional certificates of controllers with memory: the double integrator of which only the position is measured."""

from dataclasses import replace

import numpy as np
import pytest

from inc_casadi import INC, Box, Budget, Plant, Polytope, Regional, Spec, Tanh, bounds, simulate
from inc_casadi.dynamic import DynamicINC, certify_dynamic, corrected, extended, folded, observer
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear import discounted_lqr
from inc_casadi.linear.deadbeat import deadbeat_observer

DOUBLE = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
SPEC = Spec(np.eye(2), 0.1, 0.95, Box([-1, -0.5], [1, 0.5]), Box(-0.5, 0.5))
CLAIM = Regional(SPEC.initial.support, SPEC.inputs, SPEC.Q, SPEC.R, SPEC.discount)
L = deadbeat_observer(DOUBLE.A, DOUBLE.C)
READOUT = corrected(INC.saturated(discounted_lqr(DOUBLE, SPEC)[0], 0.5), np.linalg.solve(DOUBLE.A, L), DOUBLE.C)
DYNAMIC = observer(DOUBLE, L, READOUT, [0.25, -0.125])


def costs(dynamic: DynamicINC, x: np.ndarray, steps: int = 400) -> np.ndarray:
    """Costs (N,) of motions from x (2, N), written out without the extended plant."""
    xi, total = np.repeat(dynamic.xi_0[:, None], x.shape[1], axis=1), np.zeros(x.shape[1])
    for k in range(steps):
        xi_next, u = dynamic.step(xi, DOUBLE.C @ x)
        total += 0.95**k * ((x**2).sum(axis=0) + 0.1 * u[0] ** 2)
        x, xi = DOUBLE.A @ x + DOUBLE.B @ u, xi_next
    return total


@pytest.fixture(scope="module")
def certificate():
    return certify_dynamic(DOUBLE, DYNAMIC, CLAIM).require()


def test_no_static_gain_stabilizes_what_memory_does(certificate):
    # x+ = [[1 + k/2, 1], [k, 1]] x has determinant 1 - k/2 and trace 2 + k/2: p(1) = -k, p(-1) = 4, det < 1 needs k > 0.
    k = np.linspace(-10, 10, 2001)
    loops = DOUBLE.A[None] + k[:, None, None] * (DOUBLE.B @ DOUBLE.C)[None]
    assert np.all(np.max(np.abs(np.linalg.eigvals(loops)), axis=1) >= 1 - 1e-9)
    assert certificate.holds() and certificate.prove()


def test_expected_cost_is_exact(certificate):
    nodes, weights = SPEC.initial.quadrature(200)  # kinks cost an error of order 1 / 200^2
    np.testing.assert_allclose(certificate.bound, weights @ costs(DYNAMIC, nodes), rtol=1e-4)


def test_largest_cost_is_exact_and_where_it_is_said_to_be(certificate):
    at = costs(DYNAMIC, certificate.worst_start[:, None])[0]
    np.testing.assert_allclose(certificate.worst_bound, at, rtol=1e-7)
    some = costs(DYNAMIC, SPEC.initial.sample(20_000, np.random.default_rng(1)))
    assert 0.98 * certificate.worst_bound < some.max() <= certificate.worst_bound


def test_it_beats_every_linear_controller(certificate):
    floor, anything = bounds.affine_moves(DOUBLE, SPEC), bounds.any_controller(DOUBLE, SPEC)
    assert floor.holds() and anything.holds()
    assert anything.value < certificate.bound < 0.8 * floor.value


def test_folded_loop_moves_as_the_dynamic_one_does():
    memory = Box([-4.0, -3.0], [5.0, 2.5])
    problem = folded(DOUBLE, DYNAMIC, CLAIM, memory)
    start = problem.claim.initial.sample(300, np.random.default_rng(2))
    assert np.all(start[2:] > memory.upper[:, None])
    run = simulate(problem.plant, problem.inc, start, steps=15)
    begun = np.vstack([start[:2], np.repeat(DYNAMIC.xi_0[:, None], 300, axis=1)])
    plain = simulate(*extended(DOUBLE, DYNAMIC), begun, steps=15)
    np.testing.assert_allclose(run.x[:, :, 1:], plain.x[:, :, 1:], atol=1e-12)
    np.testing.assert_allclose(run.u, plain.u, atol=1e-12)


def test_memory_that_is_left_is_refused_and_one_that_is_not_suffices(certificate):
    x = simulate(*extended(DOUBLE, DYNAMIC), np.vstack([SPEC.initial.vertices, np.repeat(DYNAMIC.xi_0[:, None], 4, axis=1)]),
                 steps=50).x[2:]
    most = np.max(np.abs(x), axis=(1, 2))
    narrow = certify_dynamic(DOUBLE, DYNAMIC, CLAIM, Box(-0.9 * most, 0.9 * most))
    assert not narrow.holds() and "xi of its box" in narrow.reason and not narrow.prove()
    wide = certify_dynamic(DOUBLE, DYNAMIC, CLAIM, Box(-64 * np.ones(2), 32 * np.ones(2)))
    np.testing.assert_allclose(wide.bound, certificate.bound, rtol=1e-8)


def test_limit_that_is_not_built_in_is_watched():
    K, _ = discounted_lqr(DOUBLE, SPEC)
    linear = observer(DOUBLE, L, corrected(INC.linear(K), np.linalg.solve(DOUBLE.A, L), DOUBLE.C), DYNAMIC.xi_0)
    x = SPEC.initial.vertices
    most = max(np.max(np.abs(run)) for run in [simulate(*extended(DOUBLE, linear), np.vstack(
        [x, np.repeat(DYNAMIC.xi_0[:, None], 4, axis=1)]), steps=30).u[0]])
    for factor, kept in ((1.01, True), (0.99, False)):
        found = certify_dynamic(DOUBLE, linear, replace(CLAIM, inputs=Box(-factor * most, factor * most)))
        assert found.holds() == kept == bool(found.prove())
    assert "input exceeds" in found.reason and found.sentence.startswith("Not certified")


def test_start_on_a_polytope_and_without_limits():
    triangle = Polytope([[-1.0, 0.0], [0.0, -1.0], [1.0, 2.0]], [0.5, 0.25, 1.0])
    found = certify_dynamic(DOUBLE, DYNAMIC, Regional(triangle, None, SPEC.Q, SPEC.R, SPEC.discount)).require()
    some = costs(DYNAMIC, triangle.sample(20_000, np.random.default_rng(3)))
    assert abs(found.bound - some.mean()) < 4 * some.std() / np.sqrt(20_000)
    assert "limits" not in found.sentence


def test_evidence_of_another_controller_proves_nothing(certificate):
    unstable = DynamicINC(replace(DYNAMIC.law, V=-DYNAMIC.law.V), DYNAMIC.xi_0)
    assert not replace(certificate, dynamic=unstable).holds()
    assert not replace(certificate, evidence=replace(certificate.evidence, level=1e3 * certificate.evidence.level)).holds()
    other = replace(certificate, dynamic=DynamicINC(DYNAMIC.law, [0.0, 0.0]))
    np.testing.assert_allclose(other.bound, certify_dynamic(DOUBLE, other.dynamic, CLAIM).bound, rtol=1e-8)
    assert abs(other.bound - certificate.bound) > 1e-3


def test_start_that_rounding_would_move_is_refused():
    with pytest.raises(InvalidInputError, match=r"start from xi_0\[0\] = "):
        folded(DOUBLE, DynamicINC(DYNAMIC.law, [0.1, 0.0]), CLAIM, Box([-4, -4], [4, 4]))
    with pytest.raises(InvalidInputError, match=r"xi_0\[1\] = 5 is not in memory"):
        folded(DOUBLE, DynamicINC(DYNAMIC.law, [0.0, 5.0]), CLAIM, Box([-4, -4], [4, 4]))


def test_what_pieces_cannot_do_is_said():
    K, _ = discounted_lqr(DOUBLE, SPEC)
    smooth = observer(DOUBLE, L, INC([[0.0]], 2 * K, [[0.5]], [[0.0, 0.0]], activation=Tanh()))
    assert "not piecewise affine" in certify_dynamic(DOUBLE, smooth, CLAIM).reason
    assert "pieces" in certify_dynamic(DOUBLE, DYNAMIC, CLAIM, budget=Budget(pieces=2)).reason
    with pytest.raises(InvalidInputError, match="must be Regional"):
        certify_dynamic(DOUBLE, DYNAMIC, SPEC)  # type: ignore[arg-type]
    with pytest.raises(DimensionError, match="1 states and 1 inputs, but the plant has 2 and 1"):
        certify_dynamic(DOUBLE, DYNAMIC, Regional(Box(-1, 1), None, 1.0, 0.0), Box([-4, -4], [4, 4]))


@pytest.mark.parametrize("W, b, conewise", [([[0.0, 0.0], [0.0, 0.0]], [0.0, 0.0], True),
                                            ([[0.2, -0.3], [0.4, 0.1]], [-0.1, -0.2], False)])
def test_readouts_with_kinks_at_rest_and_with_loops_in_W(W, b, conewise):
    K, _ = discounted_lqr(DOUBLE, SPEC)
    bent = INC(W, np.vstack([0.3 * K, -0.2 * K]), [[0.3, -0.2]], 0.9 * K, b)
    bent = replace(bent, d=-bent(np.zeros(2))).with_saturated_output(SPEC.inputs)
    dynamic = observer(DOUBLE, L, corrected(bent, np.linalg.solve(DOUBLE.A, L), DOUBLE.C))
    found = certify_dynamic(DOUBLE, dynamic, CLAIM).require()
    assert found.prove() and (found.memory is not None) == (found.evidence.conewise is not None) == conewise
    nodes, weights = SPEC.initial.quadrature(60)
    np.testing.assert_allclose(found.bound, weights @ costs(dynamic, nodes, 200), rtol=1e-3)
