"""The walk from a flat set, against motions written out by hand, the folded loop, and exact arithmetic."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import INC, Box, Budget, Plant, Polytope, Regional, ReLU, Spec
from inc_casadi.dynamic import DynamicINC, certify_dynamic, corrected, filter_gains, observer, scheduled_observer
from inc_casadi.dynamic.flat import certify_flat
from inc_casadi.dynamic.fold import visited
from inc_casadi.linear import LinearController, discounted_lqr, linear_cost

PLANT = Plant([[1.2, 0.7, 0.0], [0.0, 0.8, 0.4], [0.1, 0.0, 0.9]], [[0.3], [0.0], [0.5]], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SPEC = Spec(np.diag([1.0, 0.5, 0.2]), 0.1, 0.95, Box([-0.3, -0.2, -0.1], [0.3, 0.4, 0.2]), Box(-0.8, 0.8))
CLAIM = Regional(SPEC.initial, SPEC.inputs, SPEC.Q, SPEC.R, SPEC.discount)
K = discounted_lqr(PLANT, SPEC)[0]
GAINS = filter_gains(PLANT, SPEC)
LAST = 0.9 * GAINS[0]
CONTROLLER = scheduled_observer(PLANT, SPEC, INC.saturated(K, 0.8), GAINS, LAST)


def costs(dynamic: DynamicINC, x: np.ndarray, steps: int = 100) -> tuple[np.ndarray, float]:
    """Costs (N,) of motions from x (3, N), and the largest |u|, written out without the extended plant."""
    xi, total, most = np.repeat(dynamic.xi_0[:, None], x.shape[1], axis=1), np.zeros(x.shape[1]), 0.0
    for k in range(steps):
        after, u = dynamic.step(xi, PLANT.C @ x)
        total += 0.95**k * (np.einsum("in,ij,jn->n", x, SPEC.Q, x) + 0.1 * u[0] ** 2)
        most, x, xi = max(most, float(np.max(np.abs(u)))), PLANT.A @ x + PLANT.B @ u, after
    return total, most


@pytest.fixture(scope="module")
def certificate():
    return certify_flat(PLANT, CONTROLLER, CLAIM).require()


def test_expected_and_worst_cost_are_those_of_motions(certificate):
    nodes, weights = SPEC.initial.quadrature(12)
    np.testing.assert_allclose(certificate.bound, weights @ costs(CONTROLLER, nodes)[0], rtol=5e-4)
    value, at = certificate.worst
    np.testing.assert_allclose(value, costs(CONTROLLER, at[:, None])[0][0], rtol=1e-9)
    drawn = costs(CONTROLLER, SPEC.initial.sample(2000, np.random.default_rng(0)))[0]
    assert drawn.max() <= certificate.worst_bound and CONTROLLER.order == 5


def test_it_is_proved_with_every_rounding_bounded(certificate):
    proof = certificate.prove()
    assert proof and "polytope" in proof.method


def test_folded_loop_says_the_same():
    law = observer(PLANT, PLANT.A @ LAST, corrected(INC.saturated(K, 0.8), LAST, PLANT.C), [0.0, 0.125, 0.0])
    small = Regional(Box([-0.1, 0.0, -0.1], [0.3, 0.2, 0.1]), SPEC.inputs, SPEC.Q, SPEC.R, SPEC.discount)
    flat, fold = certify_dynamic(PLANT, law, small), certify_dynamic(PLANT, law, small, visited(PLANT, law, small))
    assert flat.memory is None and fold.memory is not None
    np.testing.assert_allclose([flat.bound, flat.worst_bound], [fold.bound, fold.worst_bound], rtol=1e-8)


def test_a_linear_controller_of_high_order_costs_what_its_lyapunov_equation_says():
    rng = np.random.default_rng(1)
    linear = LinearController(0.3 * rng.standard_normal((9, 9)) / 3, rng.standard_normal((9, 1)), [[0.01] * 9], [[-0.4]])
    plant, spec = Plant(0.9, 1.0), Spec(1.0, 0.1, 0.95, Box(-1, 2), Box(-5, 5))
    found = certify_dynamic(plant, DynamicINC.from_linear(linear), Regional(spec.initial, spec.inputs, 1.0, 0.1, 0.95))
    assert found.require().inner.walk.arrived.start.shape[1] == 1
    np.testing.assert_allclose(found.bound, linear_cost(plant, spec, linear).bound, rtol=1e-6)


def test_start_need_not_be_a_float_that_a_fold_keeps():
    moved = DynamicINC(CONTROLLER.law, CONTROLLER.xi_0 + np.array([0.1, 1 / 3, 0.0, 0.0, 0.0]))
    found = certify_flat(PLANT, moved, CLAIM).require()
    nodes, weights = SPEC.initial.quadrature(12)
    np.testing.assert_allclose(found.bound, weights @ costs(moved, nodes)[0], rtol=1e-3)
    assert found.bound > certify_flat(PLANT, CONTROLLER, CLAIM).bound


def test_limits_that_are_not_built_in_are_watched_and_proved():
    free = scheduled_observer(PLANT, SPEC, INC.linear(K), GAINS, LAST)
    _, most = costs(free, SPEC.initial.vertices, 60)
    for factor, kept in ((1.001, True), (0.999, False)):
        found = certify_flat(PLANT, free, replace_inputs(factor * most))
        assert found.holds() == kept == bool(found.prove())
    assert "exceeds its limit" in found.reason and found.margins()["inputs"] < 0


def replace_inputs(most: float) -> Regional:
    return Regional(SPEC.initial, Box(-most, most), SPEC.Q, SPEC.R, SPEC.discount)


def test_polytopes_as_initial_sets():
    corner = Polytope.from_vertices(np.array([[0.0, 0.3, 0.0, 0.0], [0.0, 0.0, 0.4, 0.0], [0.0, 0.0, 0.0, 0.2]]))
    found = certify_flat(PLANT, CONTROLLER, Regional(corner, SPEC.inputs, SPEC.Q, SPEC.R, SPEC.discount)).require()
    drawn = costs(CONTROLLER, corner.sample(4000, np.random.default_rng(2)))[0]
    assert abs(found.bound - drawn.mean()) < 4 * drawn.std() / np.sqrt(4000) and found.prove()


def test_corrupted_certificates_are_refused(certificate):
    assert not replace(certificate, level=1e4 * certificate.level).holds()
    assert not replace(certificate, P=None).holds()
    turned = DynamicINC(replace(CONTROLLER.law, V=-CONTROLLER.law.V), CONTROLLER.xi_0)
    assert not replace(certificate, dynamic=turned).holds()
    assert "pieces" in replace(certificate, budget=Budget(pieces=3)).reason


def test_a_stated_cost_below_the_true_one_is_not_proved(certificate, monkeypatch):
    true = certificate.expected
    monkeypatch.setattr(type(certificate), "_mean_bound", property(lambda self: true * (1 - 1e-8)))
    assert "expected cost exceeds" in certificate.prove().reason


def test_moves_of_one_starting_point_in_fractions(certificate):
    """A vertex followed in exact arithmetic: its cost is the form of its polytope up to the rounding of floats."""
    walk = certificate.walk
    x = [Fraction(float(value)) for value in SPEC.initial.vertices[:, 0]]
    xi, total, law = [Fraction(float(value)) for value in CONTROLLER.xi_0], Fraction(0), CONTROLLER.law
    W, U, V, gain, A, B, C = ([[Fraction(float(v)) for v in row] for row in M] for M in (
        law.W, law.U, law.V, law.K, PLANT.A, PLANT.B, PLANT.C))

    def times(M, v):
        return [sum((a * b for a, b in zip(row, v, strict=True)), Fraction(0)) for row in M]

    for k in range(25):
        y = times(C, x) + xi
        eta = []
        for i in range(law.q):  # W is strictly lower triangular
            z = sum((W[i][j] * eta[j] for j in range(i)), Fraction(float(law.b[i]))) + times([U[i]], y)[0]
            low, high = (0, z) if isinstance(law.activations[i], ReLU) else (-1, 1)
            eta.append(max(Fraction(low), min(z, Fraction(high))))
        both = [a + b + Fraction(float(d)) for a, b, d in zip(times(gain, y), times(V, eta), law.d, strict=True)]
        u, xi_next = both[:1], both[1:]
        stage = sum(Fraction(float(SPEC.Q[i, i])) * x[i] ** 2 for i in range(3)) + Fraction(float(SPEC.R[0, 0])) * u[0] ** 2
        total += Fraction(0.95) ** k * stage
        x = [a + b for a, b in zip(times(A, x), times(B, u), strict=True)]
        xi = xi_next
    at = np.flatnonzero(np.all(walk.arrived.start == SPEC.initial.vertices[:, 0], axis=1))[0]
    lifted = walk.arrived.lifted()[at]
    np.testing.assert_allclose(float(total), lifted @ walk.arrived.cost[walk.arrived.owner[at]] @ lifted, rtol=1e-3)
