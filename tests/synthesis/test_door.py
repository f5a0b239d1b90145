"""The door of synthesize: continuous plants by their period, options of training checked before anything is tried."""

import control
import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, ReLU, Spec
from inc_casadi.errors import InvalidInputError
from inc_casadi.linear import discounted_lqr
from inc_casadi.sampled import sample
from synthesis import synthesize
from synthesis.attempts import TRAINED, attempt, plan
from synthesis.door import problem

PENDULUM = Plant([[0.0, 1.0], [1.0, -0.1]], [[0.0], [1.0]], dt=0)
PER_SECOND = Spec(np.diag([2.0, 0.5]), 0.1, 0.9, Box([-0.2, -0.2], [0.2, 0.2]), Box(-1, 1))
DOUBLE = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
SPEC = Spec(np.eye(2), 0.1, 0.95, Box([-3, -1.5], [3, 1.5]), Box(-0.5, 0.5))


@pytest.fixture(scope="module")
def sampled():
    return synthesize(PENDULUM, PER_SECOND, hidden=0, period=0.1, verbose=False)


def test_a_continuous_plant_with_a_period_is_sampled_and_said_to_be(sampled):
    assert sampled.status == "certified" and sampled.plant.dt == 0.1 and sampled.spec.discount == pytest.approx(0.9**0.1)
    assert "sampled every 0.1 s" in sampled.notes[0] and "sampled every 0.1 s" in str(sampled)
    assert sampled.plant.A == pytest.approx(sample(PENDULUM, PER_SECOND, 0.1).plant.A)


def test_the_certified_cost_and_the_offset_are_the_integral_of_the_held_motion(sampled):
    """Runge-Kutta of the continuous plant under the held law, 20 steps per period, from the vertices and drawn states."""
    x = PER_SECOND.initial.sample(1500, np.random.default_rng(0))
    total, h, t = np.zeros(x.shape[1]), 0.1 / 20, 0.0
    for _ in range(250):
        u = sampled.inc(x)
        for _ in range(20):
            rate = np.einsum("in,ij,jn->n", x, PER_SECOND.Q, x) + 0.1 * u[0] ** 2
            f = lambda z: PENDULUM.A @ z + PENDULUM.B @ u  # noqa: B023, E731
            k1 = f(x)
            k2 = f(x + h / 2 * k1)
            after = x + h * k2
            last = np.einsum("in,ij,jn->n", after, PER_SECOND.Q, after) + 0.1 * u[0] ** 2
            total += h / 2 * (0.9**t * rate + 0.9 ** (t + h) * last)
            x, t = after, t + h
    stated = sampled.cost + sample(PENDULUM, PER_SECOND, 0.1).offset
    assert abs(total.mean() - stated) < 4 * total.std() / np.sqrt(total.size) + 1e-3 * stated


def test_a_state_space_of_python_control_is_sampled_too():
    found = problem(control.ss(PENDULUM.A, PENDULUM.B, np.eye(2), 0), PER_SECOND, 0.1)
    np.testing.assert_array_equal(found.plant.A, problem(PENDULUM, PER_SECOND, 0.1).plant.A)


@pytest.mark.parametrize(("plant", "period", "words"), [
    (PENDULUM, None, "give it period="), (DOUBLE, 0.1, r"in discrete time already \(dt = 1\)"), (PENDULUM, 0.0, "period"),
    (PENDULUM, -1.0, "period"), (PENDULUM, np.nan, "period")])
def test_a_period_is_for_continuous_plants_and_they_need_it(plant, period, words):
    with pytest.raises(InvalidInputError, match=words):
        problem(plant, PER_SECOND, period)


def test_options_reach_training(monkeypatch):
    seen = []

    def train(plant, spec, inner, **options):
        seen.append(options)
        raise InvalidInputError("enough")

    monkeypatch.setattr("synthesis.training.train", train)
    task = next(task for task in plan(DOUBLE, SPEC, 2, ReLU(), 0.9, 0, 1.0, form="projected", options={"steps": "adam"})
                if task.way == TRAINED)
    assert "enough" in attempt(task).note
    assert seen[0]["steps"] == "adam" and seen[0]["form"] == "projected" and "horizon" not in seen[0]


def test_adam_trains_in_synthesize():
    result = synthesize(DOUBLE, SPEC, hidden=3, form="projected", training_options={"steps": "adam", "order": 4}, rounds=1,
                        training_iterations=6, tol=0.0, starts=["clipped LQR"], verbose=False)
    trained = next(one for one in result.history if one.training)
    assert trained.name == "clipped LQR, trained" and trained.estimate.settled


@pytest.mark.slow
def test_constraints_on_states_hold_on_motions_of_the_trained_law():
    """x_2 may not fall below -0.8: the clipped LQR does, a law trained under the constraint from the same box does not."""
    spec = Spec(SPEC.Q, SPEC.R, 0.95, Box([0.0, -0.4], [2.0, 0.4]), SPEC.inputs)
    states = Box([-5.0, -0.8], [5.0, 5.0])
    result = synthesize(DOUBLE, spec, hidden=2, form="lifted", training_options={"states": states}, rounds=1, tol=0.0,
                        starts=["clipped LQR"], training_seconds=30.0, training_iterations=40, verbose=False)

    def lowest(law):
        x, least = np.hstack([spec.initial.vertices, spec.initial.sample(300, np.random.default_rng(1))]), np.inf
        for _ in range(60):
            x = DOUBLE.A @ x + DOUBLE.B @ law(x)
            least = min(least, float(x[1].min()))
        return least

    trained = next(one for one in result.history if one.training)
    K, _ = discounted_lqr(DOUBLE, spec)
    assert lowest(INC.saturated(K, 0.5)) < -0.83 and lowest(trained.inc) > -0.81


@pytest.mark.parametrize(("options", "form", "words"), [
    ({"speed": 3}, "shooting", "training_options has 'speed', but may have"),
    ({"kappa": 0.5}, "shooting", "training_options has 'kappa'"),
    ({"steps": "adam"}, "shooting", "belongs to the form 'projected'"),
    ({"hessian": "none"}, "shooting", "hessian is 'none'"),
    ({"states": Box([-1.0], [1.0])}, "lifted", "states has dimension 1"),
    (["steps"], "projected", "must map names")])
def test_options_are_checked_before_anything_is_tried(options, form, words):
    with pytest.raises(InvalidInputError, match=words):
        synthesize(DOUBLE, SPEC, form=form, training_options=options, verbose=False)
