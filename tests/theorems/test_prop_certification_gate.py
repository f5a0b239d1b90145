"""prop:certification_gate: what the gate lets through is well posed, stabilizes and costs no more, wherever it came from."""

from functools import cache

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Plant, ReLU, Spec, Tanh
from inc_casadi.judgement import Cause
from synthesis.gate import gate

SPEC = Spec(np.diag([1.0, 0.5]), 0.1, 0.95, Box([-1, -2], [2, 1]))
PLANT = Plant([[0.7, 0.3], [-0.2, 0.8]], [[0.2], [1.0]])


def drawn_law(seed, size):
    """A law that no optimizer has seen."""
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(3, 3))
    units = (Tanh(), Tanh(), Tanh()) if seed % 2 else ReLU()
    return INC(0.7 * W / np.abs(W).sum(axis=1).max(), rng.normal(size=(3, 2)), size * rng.normal(size=(1, 3)),
               [[0.0, 0.0]], activation=units)


@cache
def verdict_on(seed):
    return gate(PLANT, SPEC, drawn_law(seed, 0.08))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_an_accepted_law_costs_no_more_than_certified(seed):
    inc, verdict = drawn_law(seed, 0.08), verdict_on(seed)
    assert verdict.accepted and verdict.certificate.holds()
    x0 = SPEC.initial.sample(4000, np.random.default_rng(5))
    x, u = oracles.roll_out(PLANT, inc, x0, 250)
    paid = oracles.discounted_cost(x, u, SPEC.Q, SPEC.R, SPEC.discount)
    assert np.max(np.abs(x[..., -1])) < 1e-3  # exponentially stable
    assert paid.mean() <= 1.05 * verdict.cost and verdict.cost < 1.5 * paid.mean()


def test_the_same_law_gets_the_same_verdict_by_whatever_name():
    inc = drawn_law(0, 0.08)
    order = [2, 0, 1]  # its units in another order, one of them scaled: another set of numbers, the same law
    scale = np.array([3.0, 1.0, 0.5])
    twin = INC(inc.W[np.ix_(order, order)] * scale[:, None] / scale, inc.U[order] * scale[:, None], inc.V[:, order] / scale,
               inc.K, activation=ReLU())
    assert gate(PLANT, SPEC, twin).cost == pytest.approx(verdict_on(0).cost, rel=1e-6)


def test_a_law_that_does_not_stabilize_is_refused():
    unstable = Plant([[1.2, 0.0], [0.0, 0.5]], [[1.0], [0.0]])
    verdict = gate(unstable, SPEC, INC([[0.0]], [[0.1, 0.0]], [[0.1]], [[0.0, 0.0]]))
    x, _ = oracles.roll_out(unstable, INC([[0.0]], [[0.1, 0.0]], [[0.1]], [[0.0, 0.0]]), np.array([[1.0], [0.0]]), 60)
    assert np.abs(x[0, 0, -1]) > 1e3 and not verdict.accepted and verdict.cost == np.inf and verdict.refusals


def test_a_law_that_is_not_well_posed_is_refused_before_anything_else():
    verdict = gate(PLANT, SPEC, INC([[1.5]], [[0.1, 0.0]], [[0.1]], [[0.0, 0.0]]))
    assert not verdict.accepted and verdict.causes == (Cause.ILL_POSED,)


def test_a_law_beyond_the_input_limits_is_refused():
    # u = -1.5 x stabilizes x+ = 1.5 x + u at once, but asks for 1.5 > 1 at x = 1.
    limited = Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    beyond = gate(Plant(1.5, 1.0), limited, INC.linear([[-1.5]]))
    assert beyond.causes[0] is Cause.LIMITS and not beyond.accepted
    assert gate(Plant(1.5, 1.0), limited, INC.linear([[-1.0]])).accepted


def test_no_loop_that_grows_is_said_to_converge():
    # x+ = 1.019 x with discount 0.9 costs 1 / (3 (1 - 0.9 * 1.019^2)), finite: a bounded cost is not stability.
    verdict = gate(Plant(1.02, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1)), INC.linear([[-0.001]]))
    assert verdict.cost >= 1 / (3 * (1 - 0.9 * 1.019**2))
    assert not any("converges" in proof for proof in verdict.proofs)
    assert any("does not stabilize" in refusal for refusal in verdict.refusals)
