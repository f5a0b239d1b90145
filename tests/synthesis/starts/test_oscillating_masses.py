"""Six masses on springs, three forces: what the saturated LQR loses, and how much of it the starts win back, with proof.

Y. Wang, S. Boyd, Fast model predictive control using online optimization, IEEE TCST 18(2), 2010. All eigenvalues lie on the
unit circle. The costs of both initial states were computed by others: 295.2228 and 233.1765 for the saturated LQR, 251.3849
and 216.2860 for the constrained optimum.
"""

from functools import cache

import draws
import numpy as np
import pytest

from inc_casadi import INC, Box, Empirical, Plant, Polytope, Regional, Saturation, Spec, bounds, certify
from synthesis import synthesize
from synthesis.compression import compress
from synthesis.starts.imitation import imitate, lessons
from synthesis.starts.predictive import predictive_start
from synthesis.starts.random_start import linear_start
from synthesis.starts.yardstick import yardstick
from synthesis.training import train

STATES = np.array([[1, -1, 1, -1, 1, -1] + 6 * [0], 6 * [2] + 6 * [0]], dtype=float).T
REGULATOR, OPTIMUM = np.array([295.222774, 233.176532]), np.array([251.384851, 216.285951])
LIMITS = Box([-0.5] * 3, [0.5] * 3)
ENOUGH = 2 / 3


def masses():
    springs = np.diag(np.full(6, -2.0)) + np.eye(6, k=1) + np.eye(6, k=-1)
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [springs, np.zeros((6, 6))]])
    B = np.zeros((12, 3))
    for force, (one, other) in enumerate([(0, 1), (2, 4), (3, 5)]):
        B[6 + one, force], B[6 + other, force] = 1.0, -1.0
    half = np.repeat([2.0, 1.0], 6)
    return Plant(A, B, dt=0.0).sampled(0.5), Spec(np.eye(12), np.eye(3), 1.0, Box(-half, half), LIMITS)


def costs(law, x, steps=250):
    """Costs from columns x, summed until nothing is left, apart from the yardstick."""
    plant, total = masses()[0], 0.0
    for _ in range(steps):
        u = law(x)
        total = total + np.sum(x * x, axis=0) + np.sum(u * u, axis=0)
        x = plant.A @ x + plant.B @ u
    return total


@cache
def predictive():
    return predictive_start(*masses(), samples=40, tol=2e-3)


def around(x, size):
    """A simplex of 13 vertices around x: few pieces, where a box of 12 dimensions takes 12! simplices to begin with."""
    return Polytope.from_vertices(x[:, None] + size * draws.regular_simplex(12))


def certificate(law, x, size):
    _, spec = masses()
    return certify(masses()[0], law, Regional(around(x, size), LIMITS, spec.Q, spec.R, 1.0))


def test_the_yardstick_gives_the_published_costs():
    ends = yardstick(*masses(), STATES)
    assert ends.regulator == pytest.approx(REGULATOR, rel=1e-6) and ends.optimum == pytest.approx(OPTIMUM, rel=1e-6)
    assert costs(INC.saturated(ends.K, 0.5), STATES) == pytest.approx(REGULATOR, rel=1e-6)


@pytest.mark.slow
def test_the_predictive_start_closes_the_gap_at_both_states_and_on_average():
    start = predictive()
    closed = (REGULATOR - costs(start.inc, STATES)) / (REGULATOR - OPTIMUM)
    assert np.all(closed > 0.95) and start.yardstick.closed(start.inc) > 0.95 and start.inc.q <= 60


def test_more_units_close_more():
    shares = [[cost for _, _, cost in predictive().tried[i:i + 1]][0] for i in (0, 1, 2, 4)]
    assert shares == sorted(shares, reverse=True) and shares[0] > predictive().yardstick.regulator.mean()


@pytest.mark.parametrize("state", [0, 1])
def test_the_gap_is_closed_with_proof_at_the_published_states(state):
    # No controller at all costs less than `least`; the law costs at most `most` from every state of a small simplex.
    plant, spec = masses()
    point = Spec(spec.Q, spec.R, 1.0, Empirical(STATES[:, [state]]), LIMITS)
    least = bounds.any_controller(plant, point, cells=1)
    proved = certificate(predictive().inc, STATES[:, state], 1e-4)
    assert least.holds() and proved.holds()
    assert float(least) == pytest.approx(OPTIMUM[state], rel=1e-6) and float(least) <= OPTIMUM[state] + 1e-5
    assert REGULATOR[state] - proved.worst_bound > 0.95 * (REGULATOR[state] - float(least))


@pytest.mark.slow
def test_eight_trained_units_close_two_thirds_with_proof():
    plant, spec = masses()
    small = compress(plant, spec, predictive().inc, 8, activation=Saturation())
    assert small.inner.q == 8 and small.closed > 0.9
    closed = (REGULATOR - costs(small.inc, STATES)) / (REGULATOR - OPTIMUM)
    assert np.all(closed > ENOUGH)
    for state in range(2):
        proved = certificate(small.inc, STATES[:, state], 1e-6)
        assert REGULATOR[state] - proved.worst_bound > ENOUGH * (REGULATOR[state] - OPTIMUM[state]) and proved.prove()


@pytest.mark.slow
def test_training_alone_closes_two_thirds_on_average():
    plant, spec = masses()
    ends = yardstick(plant, spec, seed=11)
    start = linear_start(ends.K, plant, spec, 8, Saturation())
    assert ends.closed(train(plant, spec, start, horizon=25).inc) > 0.85


@pytest.mark.slow
def test_imitation_alone_closes_two_thirds_on_average():
    plant, spec = masses()
    ends = yardstick(plant, spec, seed=11)
    taught = lessons(plant, spec, predictive().inc)
    found = imitate(plant, spec, taught, linear_start(ends.K, plant, spec, 8, Saturation()))
    assert ends.closed(found.inner.with_saturated_output(LIMITS)) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("state", [0, 1])
def test_synthesize_wins_two_thirds_of_what_the_saturated_regulator_loses(state):
    plant, spec = masses()
    near = Spec(spec.Q, spec.R, 1.0, around(STATES[:, state], 1e-3), LIMITS)
    result = synthesize(plant, near, hidden=0, starts=["clipped LQR", "MPC"], tol=0.0, training_seconds=60.0, verbose=False)
    assert result.require().chosen.name == "MPC" and "worst cost, which bounds the expected one" in str(result)
    assert REGULATOR[state] - result.cost >= ENOUGH * (REGULATOR[state] - OPTIMUM[state])
