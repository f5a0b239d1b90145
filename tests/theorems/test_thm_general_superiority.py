"""thm:general_superiority: limits kept and a certified cost below the first-move bound beat every linear controller."""

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, DiscountedCost, Plant, Regional, Spec, bounds, certify

BETA = 0.9
PLANT = Plant([[1.4, 0.2], [0.0, 0.3]], [[1.0], [0.1]])
SPEC = Spec(np.eye(2), 0.0, BETA, Box([-1, -0.5], [1, 0.5]), Box(-1, 1))


def first_moves(count, seed):
    """Random affine first moves u_0 = D x_0 + d with |u_0| <= 1 on the box, many of them with equality."""
    rng = np.random.default_rng(seed)
    D, d = rng.normal(size=(count, 2)) * [1.0, 0.3], 0.3 * rng.normal(size=count)
    largest = np.abs(D) @ [1.0, 0.5] + np.abs(d)
    scale = np.where(rng.uniform(size=count) < 0.8, 1.0, rng.uniform(size=count)) / largest
    return D * scale[:, None], d * scale


def move_cost(D, d):
    """E |x_0|^2 + beta E |A x_0 + B (D x_0 + d)|^2 from the moments of the box, typed again: S_0 = diag(1/3, 1/12)."""
    S0 = np.diag([1 / 3, 1 / 12])
    closed = PLANT.A[None] + PLANT.B @ D[:, None, :]
    after = np.einsum("kij,jl,kil->k", closed, S0, closed) + d**2 * float(PLANT.B[:, 0] @ PLANT.B[:, 0])
    return np.trace(S0) + BETA * after


def test_no_admissible_affine_first_move_undercuts_the_bound():
    bound = bounds.first_move(PLANT, SPEC)
    costs = move_cost(*first_moves(200_000, 81))
    assert bound.holds() and bound.value <= costs.min() < 1.005 * bound.value


def test_the_certified_law_is_admissible_and_below_the_bound():
    law = INC.saturated([[-1.4, -0.2]], 1.0)
    certificate = certify(PLANT, law, Regional(SPEC.initial, SPEC.inputs, SPEC.Q, SPEC.R, BETA)).require()
    assert certificate.bound < bounds.first_move(PLANT, SPEC).value
    x, u = oracles.roll_out(PLANT, law, SPEC.initial.sample(20_000, np.random.default_rng(82)), 80)
    paid = oracles.discounted_cost(x, u, SPEC.Q, SPEC.R, BETA)
    assert np.max(np.abs(u)) <= 1 and abs(paid.mean() - certificate.bound) < 5 * paid.std() / np.sqrt(20_000)


def test_linear_controllers_that_keep_the_limits_cost_more():
    law = INC.saturated([[-1.4, -0.2]], 1.0)
    cost = certify(PLANT, law, Regional(SPEC.initial, SPEC.inputs, SPEC.Q, SPEC.R, BETA)).require().bound
    rng, kept = np.random.default_rng(83), 0
    corners = np.array([[-1.0, -1.0, 1.0, 1.0], [-0.5, 0.5, -0.5, 0.5]])  # u_k is affine in x_0, so the corners suffice
    for _ in range(300):
        D, a, b, c = rng.uniform([-1.2, -0.5], [-0.5, 0.3])[None], rng.uniform(-0.5, 0.5), rng.normal(size=(1, 2)), 0.1
        def run(x, a=a, b=b, c=c, D=D):
            xi, total, most = np.zeros((1, x.shape[1])), np.zeros(x.shape[1]), 0.0
            for k in range(60):
                u = c * xi + D @ x
                total, most = total + BETA**k * np.sum(x**2, axis=0), max(most, np.abs(u).max())
                x, xi = PLANT.A @ x + PLANT.B @ u, a * xi + b @ x
            return total, most
        if run(corners)[1] <= 1:
            kept += 1
            nodes = np.sqrt(3) / 3 * corners  # Gauss' rule, exact for the quadratic cost of a linear loop
            assert run(nodes)[0].mean() > cost
    assert kept >= 10


@pytest.mark.parametrize("seed", range(4))
def test_the_global_inequality_alone_never_separates_a_bounded_law(seed):
    # Far out a bounded input does not count, so x'P x bounds the cost without control: P >= Q + beta A'QA. But u = 0 is a
    # linear controller when 0 is admissible, so L_lin <= tr((Q + beta A'QA) S_0) <= tr(P S_0): eq:superiority_cert fails.
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(2, 2))
    plant = Plant(A * 0.8 / np.max(np.abs(np.linalg.eigvals(A))), rng.normal(size=(2, 1)))
    spec = Spec(np.diag([1.0, 0.5]), 0.0, 0.7, Box([-1, -2], [1, 2]), Box(-1, 1))
    law = INC.saturated(0.2 * rng.normal(size=(1, 2)), 1.0)
    for rung in ("sector", "relu"):
        found = certify(plant, law, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial), multiplier=rung).require()
        P = found.values["P"]
        assert np.linalg.eigvalsh(P - spec.Q - 0.7 * plant.A.T @ spec.Q @ plant.A).min() > -1e-9
        assert found.bound >= bounds.first_move(plant, spec).value
