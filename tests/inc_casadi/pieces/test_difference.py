"""The largest difference of two laws: by hand, never exceeded by samples, attained where it says, and proved."""

from dataclasses import replace

import draws
import numpy as np
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, ReLU, Saturation
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.mpc import MPC
from inc_casadi.pieces.critical_regions import CriticalRegions
from inc_casadi.pieces.difference import largest_difference

UNITS = (ReLU(), Saturation(), LeakyReLU(0.3), ReLU())
REGION = Box([-1.0, -2.0, 0.5], [2.0, 1.0, 1.5])
C = np.array([[1.0, 0.5, 0.0], [0.0, -1.0, 2.0], [0.3, 0.0, 1.0], [1.0, 1.0, 1.0]])


def law(seed, units=UNITS, p=4):
    return draws.controller(np.random.default_rng(seed), m=2, p=p, units=units, gain=1.0, bias=0.7)


@pytest.mark.parametrize("seed", range(3))
def test_no_sample_exceeds_it_and_it_is_attained(seed):
    first, second = law(seed), law(seed + 10, UNITS[:3])
    found = largest_difference(first, second, REGION, C)
    x = REGION.sample(20_000, np.random.default_rng(seed))
    sampled = np.abs(first(C @ x) - second(C @ x)).max(axis=1)
    assert np.all(sampled <= found.each + 1e-12) and np.all(sampled > 0.8 * found.each)
    there = np.abs(first(C @ found.point) - second(C @ found.point))
    assert there[found.output] == pytest.approx(found.value, rel=1e-12) and REGION.contains(found.point, 1e-12)
    assert found.value == found.each.max() == found.each[found.output]
    assert "at most" in found.sentence and found.bound > found.value


def test_by_hand():
    # |2 x - sat(2 x)| on [-2, 1.5]: largest at -2, where it is 3.
    found = largest_difference(INC.linear([[2.0]]), INC.saturated([[2.0]], 1.0), Box([-2.0], [1.5]))
    assert found.value == 3.0 and found.point.tolist() == [-2.0] and found.pieces == 3


def test_order_does_not_matter():
    there, back = (largest_difference(law(i), law(j), REGION, C).value for i, j in ((1, 2), (2, 1)))
    assert there == pytest.approx(back, rel=1e-12)


def test_the_same_law_in_two_forms():
    # K2 < 1 in u = sat(K1 x + K2 dz(v)) leaves the law as it is, so W = K2 in sat(W eta + ...) rescaled does.
    plain = INC.saturated([[1.5, -0.5]], 1.0)
    implicit = INC([[0.5]], 0.5 * plain.U, plain.V, plain.K, activation=Saturation())
    found = largest_difference(plain, implicit, Box([-3.0, -1.0], [2.0, 4.0]))
    assert found.value < 1e-14 and found.prove()


def test_the_proof_settles_the_bound_and_refuses_a_smaller_one():
    first, second = law(3, UNITS[:2], 2), law(4, UNITS[1:3], 2)
    found = largest_difference(first, second, Box([-1.0, -1.0], [1.0, 2.0]))
    proof = found.prove()
    assert proof and proof.method == "exact fractions over all pieces"
    smaller = replace(found, value=found.value * (1 - 1e-8), size=0.0).prove()
    assert not smaller and "in exact arithmetic the laws differ by" in smaller.reason
    assert "ended the exact comparison" in found.prove(seconds=-1.0).reason


def test_a_budget_leaves_a_lower_bound():
    first, second = law(1), law(2)
    first, second = (replace(inc, U=2 * inc.U) for inc in (first, second))
    whole = largest_difference(first, second, REGION, C)
    for pieces in (0, 40, 60, 80, 100):
        part = largest_difference(first, second, REGION, C, pieces=pieces)
        assert part.ended and part.bound == np.inf and "at least" in part.sentence and not part.prove()
        assert part.value <= whole.value + 1e-12
        there = np.abs(first(C @ part.point) - second(C @ part.point))
        assert there[part.output] == pytest.approx(part.value, rel=1e-12) or part.value == 0.0


def test_a_predictive_law_against_its_inc_and_its_regulator():
    plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.3], [1.0]])
    mpc = MPC(plant, np.diag([1.0, 0.0]), [[0.5]], 3, Box([-1.0], [0.8]))
    region = Box([-8.0, -3.0], [6.0, 4.0])
    same = largest_difference(mpc.inc(), mpc, region)
    assert same.value < 1e-12 and "quadratic program" in same.prove().reason
    clipped = INC.linear(mpc.inc().jacobian([0.0, 0.0])).with_saturated_output(mpc.inputs)
    found = largest_difference(clipped, CriticalRegions(mpc), region)
    x = region.sample(400, np.random.default_rng(0))
    sampled = max(abs(mpc.solve(point)[0, 0] - clipped(point)[0]) for point in x.T)
    assert 0.5 * found.value < sampled <= found.value + 1e-6 and found.value > 0.5
    assert abs(mpc.solve(found.point)[0, 0] - clipped(found.point)[0]) == pytest.approx(found.value, abs=2e-6)


def test_what_is_refused():
    with pytest.raises(DimensionError, match="the second law reads 2 measurements"):
        largest_difference(law(0), INC.linear(np.ones((2, 2))), REGION, C)
    with pytest.raises(DimensionError, match="2 outputs and the second 1"):
        largest_difference(law(0), INC.linear(np.ones((1, 4))), REGION, C)
    with pytest.raises(InvalidInputError, match="the first law must be an INC"):
        largest_difference("a law", law(0), REGION, C)
    mpc = MPC(Plant(np.eye(2), np.ones((2, 2))), np.eye(2), np.eye(2), 2, Box([-1.0] * 2, [1.0] * 2))
    with pytest.raises(DimensionError, match="the second law reads 2 states"):
        largest_difference(law(0), mpc, REGION, C)
