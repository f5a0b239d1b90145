"""thm:input_penalty_sep, thm:longrun_dyn, thm:lsof_sep, cor:genuine_of: the closed forms, by fractions and by rivals."""

from fractions import Fraction as F

import numpy as np
import pytest

from inc_casadi.bounds import ScalarSeparation

BETAS = (F(1, 10), F(1, 2), F(9, 10), F(1))
CASES = [(beta, share * beta) for beta in BETAS for share in (F(0), F(1, 10), F(1, 4), F(1, 2))]


def integral(coefficients, low, high):
    """The exact integral of a polynomial, coefficients from the constant up."""
    return sum(c * (high ** (k + 1) - low ** (k + 1)) / (k + 1) for k, c in enumerate(coefficients))


def law_cost(beta, r):
    """The cost of u = -sat(1.5 x) by the integrals of the paper's proof, x in [0, 1] by symmetry."""
    edge = F(2, 3)
    inner = [0, 0, 1 + r * F(9, 4)]                        # x^2 + r (1.5 x)^2, then 0
    after = [1, -3, F(9, 4)]                               # x_1^2 = (1.5 x - 1)^2
    outer = [r + beta * (1 + F(9, 4) * r) * after[0], beta * (1 + F(9, 4) * r) * after[1],
             1 + beta * (1 + F(9, 4) * r) * after[2]]      # x^2 + r + beta (x_1^2 + r (1.5 x_1)^2), then 0
    return integral(inner, F(0), edge) + integral(outer, edge, F(1))


@pytest.mark.parametrize(("beta", "r"), CASES)
def test_the_law_costs_what_the_theorem_says(beta, r):
    stated = F(1, 3) + beta / 36 + r * (F(5, 9) + beta / 16)
    assert law_cost(beta, r) == stated == ScalarSeparation(beta, r).relu_law


@pytest.mark.parametrize(("beta", "r"), CASES)
def test_no_admissible_first_move_undercuts_the_bound(beta, r):
    stated = float(F(1, 3) + r / 3 + beta / 12)
    assert ScalarSeparation(beta, r).dynamic_linear == F(1, 3) + r / 3 + beta / 12
    rng = np.random.default_rng(71)
    kappa = rng.uniform(-1, 1, 4000)
    d = (1 - np.abs(kappa)) * rng.uniform(-1, 1, 4000)
    x = np.linspace(-1, 1, 2001)  # Simpson's rule, exact for these quadratics
    weights = np.where(np.arange(2001) % 2, 4.0, 2.0)
    weights[[0, -1]] = 1
    weights /= weights.sum()
    u = kappa[:, None] * x[::40] + d[:, None]
    assert np.abs(u).max() <= 1 + 1e-12
    u = kappa[:, None] * x + d[:, None]
    paid = (x**2 + float(r) * u**2 + float(beta) * (1.5 * x + u) ** 2) @ weights
    assert paid.min() >= stated - 1e-12
    best = (x**2 + float(r) * x**2 + float(beta) * (0.5 * x) ** 2) @ weights  # kappa = -1, d = 0 attains it
    assert best == pytest.approx(stated, rel=1e-12)


@pytest.mark.parametrize("beta", [F(1, 10), F(1, 2), F(1)])
def test_the_law_wins_below_the_threshold_only(beta):
    threshold = 8 * beta / (32 + 9 * beta)
    assert ScalarSeparation(beta).threshold == threshold < beta / 2
    for r, wins in ((threshold * F(999, 1000), True), (threshold, False), (threshold * F(1001, 1000), False)):
        assert (law_cost(beta, r) < F(1, 3) + r / 3 + beta / 12) == wins == ScalarSeparation(beta, r).separated


def test_linear_controllers_with_memory_cost_more():
    # Random controllers of order one, scaled until |u_k| <= 1 on both ends: u_k is affine in x_0, so the ends suffice.
    rng = np.random.default_rng(72)
    beta, r, kept = 0.9, 0.1, 0
    for _ in range(800):
        a_c, b_c, c_c, d_c, xi = *rng.uniform(-1, 1, 3), rng.uniform(-1.6, -0.6), 0.0
        x, memory, total = np.array([-1.0, 1.0]), np.array([xi, xi]), 0.0
        for k in range(60):
            u = c_c * memory + d_c * x
            if np.max(np.abs(u)) > 1 + 1e-12 or np.max(np.abs(x)) > 10:
                break
            total += beta**k * np.mean(x**2 + r * u**2) / 3
            x, memory = 1.5 * x + u, a_c * memory + b_c * x
        else:
            kept += 1
            assert total > float(law_cost(F(9, 10), F(1, 10)))
            assert total >= float(ScalarSeparation(beta, r).dynamic_linear) - 1e-12
    assert kept >= 5


@pytest.mark.parametrize("beta", [F(1, 10), F(1, 2), F(1)])
def test_the_best_static_gain_and_the_embedding(beta):
    # thm:lsof_sep: J(F) = 1 / (3 (1 - beta (1.5 + F)^2)), least at F = -1; cor:genuine_of adds the same to all.
    gains = [F(-1) + F(k, 50) for k in range(101)]
    costs = [1 / (3 * (1 - beta * (F(3, 2) + gain) ** 2)) for gain in gains if beta * (F(3, 2) + gain) ** 2 < 1]
    assert min(costs) == costs[0] == 1 / (3 * (1 - beta / 4)) == ScalarSeparation(beta).static_linear
    assert costs[0] - law_cost(beta, F(0)) == beta * (8 + beta) / (144 * (1 - beta / 4)) > 0
    wide = ScalarSeparation(beta, alpha=F(1, 2), weight=F(3))
    free = 3 * F(1, 3) / (1 - beta / 4)  # sum of beta^k alpha^(2k) 3 E x_2^2
    assert (wide.relu_law - law_cost(beta, F(0)), wide.static_linear - costs[0]) == (free, free)
