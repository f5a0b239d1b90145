"""Rest at the origin in exact arithmetic: checked in Fractions, close to the law, limits kept, refusals."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Regional, ReLU, Saturation, Tanh, certify
from inc_casadi.errors import InvalidInputError
from inc_casadi.exact_rest import rest_point
from inc_casadi.output_range import within_limits
from synthesis.starts.resting import resting

LIMITS = Box([-0.3, -0.7], [0.3, 0.7])


def anchored(seed, q=5, bias=1.0):
    """A law of mixed units with loops in W and u(0) = 0 up to rounding, clipped to the limits."""
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(q, q))
    W *= 0.6 / np.abs(W).sum(axis=1, keepdims=True)
    V, K = 0.2 * rng.normal(size=(2, q)), 0.1 * rng.normal(size=(2, 3))
    parts = W, rng.normal(size=(q, 3)), V, K, bias * rng.normal(size=q)
    units = (ReLU(), Saturation(), ReLU(), Saturation(), Saturation())
    d = -INC(*parts, activation=units)(np.zeros(3))
    return INC(*parts, d, units).with_saturated_output(LIMITS)


def offset(inc):
    """u(0) in Fractions by Picard steps, which end where eta repeats."""
    eta = [Fraction(0)] * inc.q
    for _ in range(200):
        z = [sum((Fraction(w) * e for w, e in zip(row, eta, strict=True)), Fraction(b))
             for row, b in zip(inc.W, inc.b, strict=True)]
        after = [max(v, Fraction(0)) if isinstance(unit, ReLU) else min(max(v, Fraction(-1)), Fraction(1))
                 for v, unit in zip(z, inc.activations, strict=True)]
        after = [Fraction(round(v * 2**60), 2**60) for v in after]
        if after == eta:
            break
        eta = after
    return [sum((Fraction(v) * e for v, e in zip(row, eta, strict=True)), Fraction(d))
            for row, d in zip(inc.V, inc.d, strict=True)]


@pytest.mark.parametrize("seed", range(6))
def test_the_law_rests_exactly_and_is_nearly_the_same(seed):
    law = anchored(seed)
    exact = resting(law)
    assert offset(exact) == [0, 0]
    rest = rest_point(Plant(0.5 * np.eye(3), np.eye(3, 2)), exact)
    assert rest is not None and not rest.x.any() and not rest.u.any()
    y = 2 * np.random.default_rng(seed).normal(size=(3, 200))
    assert exact(y) == pytest.approx(law(y), abs=1e-4)
    assert within_limits(exact, LIMITS) and np.all(np.abs(exact.W) <= np.abs(law.W))


def test_an_offset_of_the_output_is_made_exact():
    law = anchored(2)
    inner = INC(law.W[:5, :5], law.U[:5], 0.3 * law.W[5:, :5], 0.3 * law.U[5:], law.b[:5], 0.3 * law.b[5:],
                law.activations[:5])
    assert any(offset(inner)) and offset(resting(inner)) == [0, 0] and np.all(resting(inner).d != 0)


def test_a_law_without_biases_keeps_them_zero():
    law = anchored(1, bias=0.0)
    exact = resting(law)
    assert not exact.b.any() and not exact.d.any()


def test_the_cost_without_discount_is_proved_only_of_the_rounded_law():
    plant, claim = Plant([[0.9]], [[1.0]]), Regional(Box([-1.0], [1.0]), Box([-1.0], [1.0]), [[1.0]], [[1.0]])
    law = INC([[0.3]], [[1.0]], [[0.1]], [[-0.5]], b=[0.1])
    law = INC(law.W, law.U, law.V, law.K, law.b, -law([0.0]), law.activation).with_saturated_output(Box([-1.0], [1.0]))
    assert not certify(plant, law, claim).prove() and certify(plant, resting(law), claim).prove()


def test_what_cannot_be_exact_is_refused():
    with pytest.raises(InvalidInputError, match="others"):
        resting(INC([[0.1]], [[1.0]], [[1.0]], [[1.0]], activation=Tanh()))
    with pytest.raises(InvalidInputError, match="d of output 0"):
        resting(INC(np.zeros((2, 2)), np.ones((2, 1)), [[1.0, 1.0]], [[0.0]], b=[1e12, 0.3]))
