"""No static gain undercuts the bound: published figures, closed forms, dense samples; and altered numbers are refused."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from gain_draws import admissible, draw, longest

from benchmarks.baselines.linear import control_lqr_gain, dense_search, lyapunov_costs
from benchmarks.plants import output_feedback, scalar, two_state
from inc_casadi import Box, Ellipsoid, Empirical, Gaussian, Plant, Polytope, Spec, Uniform
from inc_casadi.bounds import gain_upper, static_output_feedback
from inc_casadi.errors import DimensionError, InfeasibleError, InvalidInputError
from inc_casadi.linear import StaticGain

POSITION = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])  # a double integrator, only its place is measured


@pytest.fixture(scope="module")
def two_states():
    case = two_state()
    return static_output_feedback(case.plant, case.spec, gap=1e-3)


def test_the_best_gain_of_the_two_state_plant_is_best_within_a_thousandth(two_states):
    assert two_states.upper == pytest.approx(3.347184, abs=2e-6)
    np.testing.assert_allclose(two_states.gain, [[-0.3535, -0.8965]], atol=2e-4)
    assert 0 <= two_states.gap < 1e-3 and two_states.holds() and two_states.prove().succeeded
    assert two_states.cells < 5000


def test_a_dense_search_finds_nothing_below(two_states):
    _, cost = dense_search(two_states.plant, two_states.spec)
    assert two_states.value < cost < two_states.value * 1.002


@pytest.mark.parametrize("limits", ["initial", "always"])
@pytest.mark.parametrize("beta", [0.3, 0.7, 0.9, 1.0])
def test_the_scalar_plant_has_the_published_minimum(beta, limits):
    case = scalar(beta)
    bound = static_output_feedback(case.plant, case.spec, gap=1e-3, limits=limits)
    true = 1 / (3 * (1 - beta / 4))  # thm:lsof_sep
    assert true * (1 - 1e-3) < bound.value < true
    np.testing.assert_allclose(bound.gain, [[-1.0]], atol=1e-6)


@pytest.mark.parametrize("alpha, weight", [(0.5, 0.0), (-0.8, 0.7)])
def test_the_embedded_plant_has_the_published_minimum(alpha, weight):
    case = output_feedback(alpha, 0.9, weight)
    bound = static_output_feedback(case.plant, case.spec, gap=1e-3, limits="always")
    true = 1 / (3 * (1 - 0.9 / 4)) + weight / (3 * (1 - 0.9 * alpha**2))  # cor:genuine_of
    assert true * (1 - 1e-3) < bound.value < true and bound.gap < 1e-3


def test_where_no_gain_stabilizes_the_bound_grows_without_end():
    spec = Spec(np.eye(2), 0.1, 1.0, Box([-1, -1], [1, 1]), Box(-1, 1))
    F = np.linspace(-1, 1, 2001)
    assert np.all(np.isinf(lyapunov_costs(POSITION, spec, F[:, None, None])))
    found = [static_output_feedback(POSITION, spec, cells=cells) for cells in (1, 30, 300, 1000)]
    values = [bound.value for bound in found]
    assert np.all(np.diff(values) > 0) and values[-1] > 50 and values[-1] > 10 * values[1]
    assert all(bound.holds() and bound.gain is None and bound.upper == np.inf == bound.gap for bound in found)
    assert "none of finite cost was found" in found[0].statement and found[2].cells == 300


@pytest.mark.parametrize("shape", [(3, 1, 1), (3, 2, 1), (2, 1, 2), (3, 1, 3), (4, 2, 2)])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_no_admissible_gain_costs_less(shape, seed):
    plant, spec = draw(seed, *shape)
    bound = static_output_feedback(plant, spec, gap=0.05, seconds=20)
    assert bound.holds()
    vertices, rng = spec.initial.vertices, np.random.default_rng(seed)
    gains = admissible(plant, spec, vertices, bound.box.lower, bound.box.upper, 40_000, rng)
    near = bound.gain.ravel()
    close = admissible(plant, spec, vertices, near - 0.02, near + 0.02, 20_000, rng)
    costs = np.concatenate([lyapunov_costs(plant, spec, gains), lyapunov_costs(plant, spec, close)])
    assert costs.size > 100 and np.min(costs) >= bound.value
    assert bound.value <= bound.upper == pytest.approx(float(lyapunov_costs(plant, spec, bound.gain[None])[0]), rel=1e-8)
    assert bound.gap < 0.05


@pytest.mark.parametrize("seed", [4, pytest.param(6, marks=pytest.mark.slow)])
def test_limits_kept_always_cost_at_least_as_much(seed):
    plant, spec = draw(seed, 2, 1, 2, radius=1.08)
    first = static_output_feedback(plant, spec, gap=3e-3)
    always = static_output_feedback(plant, spec, gap=3e-3, limits="always", seconds=10)
    assert always.holds() and always.gap < 3e-3 and "at all times" in always.statement
    assert longest(plant, spec, always.gain, spec.initial.vertices) < 1e-8
    assert longest(plant, spec, first.gain, spec.initial.vertices) > 1e-3
    assert always.value > first.upper * 1.01  # here later moves matter
    rng, vertices = np.random.default_rng(0), spec.initial.vertices
    gains = admissible(plant, spec, vertices, always.box.lower, always.box.upper, 4000, rng)
    x, kept = np.broadcast_to(vertices, (len(gains), *vertices.shape)), np.ones(len(gains), dtype=bool)
    for _ in range(300):
        kept &= np.all(spec.inputs.H @ gains @ plant.C @ x <= spec.inputs.h[:, None], axis=(1, 2))
        x = np.clip((plant.A + plant.B @ gains @ plant.C) @ x, -1e9, 1e9)
    assert np.sum(kept) > 5 and np.min(lyapunov_costs(plant, spec, gains[kept])) >= always.value


def test_without_limits_full_state_feedback_is_the_regulator():
    plant, spec = draw(0, 3, 2, 1)
    plant, spec = Plant(plant.A, plant.B), replace(spec, inputs=None)
    bound = static_output_feedback(plant, spec, gap=1e-4)
    K = control_lqr_gain(plant, spec)
    assert bound.holds() and bound.gap < 1e-4
    assert bound.value == pytest.approx(float(lyapunov_costs(plant, spec, K[None])[0]), rel=1e-4)
    assert "input limits" not in bound.statement


def test_without_limits_a_single_output_gain_is_found_on_a_line():
    plant, spec = draw(1, 3, 1, 1)
    spec = replace(spec, inputs=None)
    bound = static_output_feedback(plant, spec, gap=1e-4)
    costs = lyapunov_costs(plant, spec, np.linspace(-3, 3, 60_001)[:, None, None])
    assert bound.holds() and np.min(costs) * (1 - 2e-4) < bound.value <= np.min(costs)


@pytest.mark.slow
@pytest.mark.parametrize("initial", [
    Uniform(Ellipsoid(np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.2], [0.0, 0.2, 1.5]]), [0.1, -0.1, 0.2])),
    Polytope.from_vertices(np.array([[1.0, 0, 0, -1, 0.3], [0, 1.0, 0, -1, 0.2], [0, 0, 1.0, -0.5, -1.0]])),
    Empirical(np.array([[1.0, -0.5, 0.2], [0.3, 0.8, -1.0], [-0.4, 0.1, 0.9]]), weights=[0.5, 0.3, 0.2])])
def test_other_initial_sets_and_polytopes_of_inputs(initial):
    plant, spec = draw(1, 3, 2, 1)
    inputs = Polytope([[1.0, 0.5], [-1.0, 0.2], [0.1, -1.0]], [0.5, 0.6, 0.4])
    spec = replace(spec, initial=initial, inputs=inputs)
    bound = static_output_feedback(plant, spec, gap=5e-3)
    assert bound.holds() and bound.gap < 5e-3
    if isinstance(spec.initial, Uniform):
        points = spec.initial.sample(400, np.random.default_rng(0))
        if isinstance(spec.initial.support, Polytope):
            points = spec.initial.support.vertices
    else:
        points = spec.initial.vertices
    gains = admissible(plant, spec, points, bound.box.lower, bound.box.upper, 40_000, np.random.default_rng(1))
    if not isinstance(spec.initial.support, Ellipsoid):
        assert np.min(lyapunov_costs(plant, spec, gains)) >= bound.value
    else:  # samples let through gains that the whole set excludes: they are shrunk until they are surely admissible
        rows = np.einsum("fm,gmp,pn->gfn", inputs.H, gains, plant.C)
        spread = np.sqrt(np.einsum("gfn,nm,gfm->gf", rows, np.linalg.inv(spec.initial.support.P), rows))
        most = rows @ spec.initial.support.center + spread
        gains = gains * np.minimum(1.0, np.min(inputs.h / np.maximum(most, 1e-9), axis=1))[:, None, None]
        assert np.min(lyapunov_costs(plant, spec, gains)) >= bound.value


def test_a_valley_that_local_search_misses_is_found_from_the_middle_of_a_box(monkeypatch):
    case = two_state()
    poor = StaticGain(np.array([[-0.2, -0.9]]), 10.0, True)
    monkeypatch.setattr(gain_upper, "best_static_gain", lambda plant, spec, seed: poor)
    bound = static_output_feedback(case.plant, case.spec, gap=1e-3)
    assert bound.upper == pytest.approx(3.347184, abs=1e-5) and bound.gap < 1e-3 and bound.holds()


def test_a_budget_that_runs_out_leaves_a_bound():
    case = two_state()
    found = [static_output_feedback(case.plant, case.spec, gap=1e-3, cells=cells) for cells in (1, 20, 200)]
    assert [bound.cells for bound in found] == [1, 20, 200]
    values = [bound.value for bound in found]
    assert np.all(np.diff(values) > 0) and 0.4266 < values[0] and values[-1] < 3.347184
    assert all(bound.holds() for bound in found)
    hasty = static_output_feedback(case.plant, case.spec, gap=1e-3, seconds=1e-6)
    assert hasty.cells == 1 and hasty.holds()


def test_altered_numbers_are_refused(two_states):
    bound = two_states
    assert replace(bound, value=bound.value - 0.1).holds()
    assert not replace(bound, value=bound.value * (1 + 1e-6)).holds()
    assert not replace(bound, value=float("nan")).holds()
    record = bound.record
    fewer = replace(record, cut=record.cut[:-40], along=record.along[:-40])
    twice = replace(record, cut=np.append(record.cut, record.cut[-1]), along=np.append(record.along, 0))
    assert not replace(bound, record=fewer).holds() and "a box of gains" in replace(bound, record=fewer).reason()
    assert "cover" in replace(bound, record=twice).reason()
    assert "cannot occur" in replace(bound, points=1.001 * bound.points).reason()
    assert "imply" in replace(bound, box=replace(bound.box, upper=bound.box.upper - 0.1)).reason()
    for other in (replace(bound.spec, inputs=Box(-1.01, 1.01)), replace(bound.spec, discount=0.97),
                  replace(bound.spec, Q=0.99 * bound.spec.Q)):
        assert not replace(bound, spec=other).holds()
    proof = replace(bound, value=bound.value * (1 + 1e-6)).prove()
    assert not proof and "a box of gains" in proof.reason


def test_a_box_of_other_points_and_singular_coordinates_are_refused(two_states):
    assert "multipliers" in replace(two_states, points=two_states.points[:, :1]).reason()
    assert "singular" in replace(two_states, coordinates=np.ones((2, 2))).reason()
    assert replace(two_states, coordinates=2 * two_states.coordinates).holds()


def test_it_does_not_depend_on_coordinates_or_units():
    plant, spec = draw(1, 3, 2, 1)
    T, units = np.random.default_rng(3).standard_normal((3, 3)), np.array([1e-2, 30.0])
    back = np.linalg.inv(T)
    there = Plant(T @ plant.A @ back, T @ plant.B * units, C=7.0 * plant.C @ back)
    start = Polytope.from_vertices(T @ spec.initial.vertices)
    moved = Spec(1e4 * back.T @ spec.Q @ back, 1e4 * spec.R * np.outer(units, units), spec.discount, start,
                 Box(spec.inputs.lower / units, spec.inputs.upper / units))
    here, other = static_output_feedback(plant, spec, gap=1e-3), static_output_feedback(there, moved, gap=1e-3)
    assert other.holds() and other.gap < 1e-3
    assert other.value == pytest.approx(1e4 * here.value, rel=2e-3)


def test_refusals_name_the_reason():
    plant, spec = draw(0)
    with pytest.raises(InvalidInputError, match="Gaussian"):
        static_output_feedback(plant, replace(spec, initial=Gaussian(np.zeros(3), np.eye(3))))
    with pytest.raises(InvalidInputError, match="continuous"):
        static_output_feedback(Plant(plant.A, plant.B, dt=0.0), spec)
    with pytest.raises(InvalidInputError, match='limits is .sometimes'):
        static_output_feedback(plant, spec, limits="sometimes")
    for wrong in ({"gap": 0.0}, {"gap": 1.0}, {"cells": 0}, {"seconds": 0.0}, {"seed": -1}):
        with pytest.raises(InvalidInputError, match=next(iter(wrong))):
            static_output_feedback(plant, spec, **wrong)
    with pytest.raises(InvalidInputError, match="16 entries"):
        static_output_feedback(Plant(np.eye(4) / 2, np.eye(4)), Spec(np.eye(4), np.eye(4), 0.9, Box([-1] * 4, [1] * 4)))
    with pytest.raises(InfeasibleError, match="no static gain"):
        static_output_feedback(plant, replace(spec, inputs=Box([0.1, 0.1], [1.0, 1.0])))
    with pytest.raises(DimensionError):
        static_output_feedback(POSITION, spec)


def test_a_gaussian_will_do_where_nothing_is_limited():
    plant, spec = draw(0, 3, 1, 1)
    spec = replace(spec, inputs=None, initial=Gaussian(np.zeros(3), np.diag([0.3, 0.2, 0.1])))
    bound = static_output_feedback(plant, spec)
    assert bound.holds() and bound.gap < 0.01


def test_the_statement_is_true_and_names_the_class(two_states):
    words = two_states.statement
    assert float(words.split("at least ")[1].split(" ")[0]) <= two_states.value == float(two_states)
    assert float(words.split("found costs ")[1].rstrip(".")) >= two_states.upper
    assert "Every static linear gain" in words and "at the first move" in words


def test_progress_is_printed_when_asked_for(capsys):
    case = scalar(0.9)
    static_output_feedback(case.plant, case.spec, gap=1e-6, verbose=True)
    assert "boxes" in capsys.readouterr().out


def test_a_control_state_space_will_do():
    control = pytest.importorskip("control")
    case = scalar(0.9)
    there = control.ss(case.plant.A, case.plant.B, case.plant.C, np.zeros((1, 1)), True)
    assert static_output_feedback(there, case.spec).holds()


def test_rechecking_loads_no_solver(tmp_path, two_states):
    import pickle

    path = tmp_path / "bound.pickle"
    path.write_bytes(pickle.dumps(two_states))
    code = (f"import pickle, sys; bound = pickle.loads(open({str(path)!r}, 'rb').read()); assert bound.holds(); "
            "assert not {'scipy', 'cvxpy', 'clarabel'} & set(sys.modules), 'a solver was loaded'")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in sys.path if part)}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
