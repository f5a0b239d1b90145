"""The named baselines: what each promises, against simulation, quadratic programs and python-control."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.optimize import minimize

from benchmarks.baselines import BASELINES, Designed, control_lqr_gain, design
from benchmarks.baselines.dynamic import best_dynamic, work
from benchmarks.baselines.estimated import saturated_lqg, scaled_lqg
from benchmarks.baselines.filters import kalman, noise
from benchmarks.baselines.improved import improved, shares
from benchmarks.baselines.kept import certified, largest_kept
from benchmarks.baselines.predictive import horizon, predictive
from benchmarks.baselines.saturated import clipped_gain
from benchmarks.baselines.static import best_linear_gain, scaled_lqr
from benchmarks.plants import Case, scalar, suite, two_state
from inc_casadi import INC, Box, Plant, Polytope, Spec, simulate
from inc_casadi.dynamic import DynamicINC, observer_gain
from inc_casadi.errors import InfeasibleError, InvalidInputError
from inc_casadi.linear import LinearController, best_static_gain, linear_cost, lqg

CASES = suite()
POLYTOPE = Case(Plant(1.5, 1.0), Spec(1.0, 0.1, 1.0, Box(-1, 1), Polytope([[1.0], [-1.0]], [1, 1])), "a polytope of limits")
BLIND = Case(Plant(np.diag([1.1, 0.5]), np.ones((2, 1)), [[0.0, 1.0]]),
             Spec(np.eye(2), 1.0, 0.98, Box([-1, -1], [1, 1]), Box(-1, 1)), "an unstable mode that is not measured")


def inputs(case: Case, controller: INC | LinearController | DynamicINC, steps: int = 200) -> np.ndarray:
    """Inputs (m, N, steps) from all vertices of the initial set."""
    x = case.spec.initial.vertices
    memory = np.repeat(getattr(controller, "xi_0", np.zeros(0))[:, None], x.shape[1], axis=1)
    seen = []
    for _ in range(steps):
        y = case.plant.C @ x
        if isinstance(controller, INC):
            u = controller(y)
        else:
            memory, u = controller.step(memory, y)
        x = case.plant.A @ x + case.plant.B @ u
        seen.append(u)
    return np.stack(seen, axis=-1)


def largest_share(case: Case, controller: INC | LinearController | DynamicINC, steps: int = 200) -> float:
    """The largest share of a limit that an input takes."""
    u, limits = inputs(case, controller, steps), case.spec.inputs
    assert isinstance(limits, Box)
    return float(np.max(np.maximum(u / limits.upper[:, None, None], u / limits.lower[:, None, None])))


def test_the_baselines_have_their_names_in_order():
    assert list(BASELINES) == ["best linear gain", "scaled LQR", "saturated LQR", "clipped gain", "LQG", "saturated LQG",
                               "best dynamic linear", "MPC"]


@pytest.fixture(scope="module")
def designs() -> dict[str, dict[str, Designed]]:
    return {name: design(CASES[name]) for name in ("two states", "motor, output")}


def assert_fits(case: Case, designed: dict[str, Designed]) -> None:
    for key, one in designed.items():
        assert (one.controller is None) == (one.reason != "") and one.seconds >= 0, key
        if one.controller is not None:
            assert (one.controller.p, one.controller.m) == (case.plant.p, case.plant.m), key
            assert largest_share(case, one.controller) <= 1 + 1e-9, key


@pytest.mark.slow
def test_a_plant_gets_a_controller_that_fits_it_and_keeps_the_limits_or_a_reason(designs: dict[str, dict[str, Designed]]):
    for name, designed in designs.items():
        assert_fits(CASES[name], designed)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.plant.n <= 7])
def test_every_plant_gets_controllers_that_fit_it_and_keep_the_limits(name: str):
    designed = design(CASES[name])
    assert_fits(CASES[name], designed)
    assert all(designed[key].controller is not None for key in
               (("saturated LQR", "MPC") if CASES[name].plant.full_state else ("saturated LQG", "MPC")))


def test_full_state_and_measured_output_have_their_own_baselines(designs: dict[str, dict[str, Designed]]):
    none = {name: {key for key, one in designed.items() if one.controller is None} for name, designed in designs.items()}
    assert none == {"two states": {"clipped gain", "LQG", "saturated LQG"}, "motor, output": {"scaled LQR", "saturated LQR"}}


def test_only_refusals_of_the_toolbox_become_reasons():
    def fails(case: Case, seed: int) -> None:
        raise TypeError("a mistake")

    def refuses(case: Case, seed: int) -> None:
        raise InfeasibleError(f"nothing with seed {seed}")
    assert design(two_state(), 7, {"none": refuses})["none"].reason == "nothing with seed 7"
    with pytest.raises(TypeError, match="a mistake"):
        design(two_state(), 0, {"broken": fails})


@pytest.mark.parametrize(("name", "most"), [
    ("two lags", 8.262),  # 8.635 by scaling the best gain without limits
    ("AC17", 9.631),  # 9.649 by scaling
    pytest.param("pendulum", 26.63, marks=pytest.mark.slow),  # which no scaled gain keeps
    pytest.param("REA1", 2.95, marks=pytest.mark.slow)])
def test_the_best_linear_gain_keeps_the_limits_later_on_where_the_search_alone_does_not(name: str, most: float):
    case = CASES[name]
    alone, law = INC.linear(best_static_gain(case.plant, case.spec).F), best_linear_gain(case)
    assert largest_share(case, alone) > 1.003
    assert 0.9 < largest_share(case, law) <= 1 + 1e-9
    assert linear_cost(case.plant, case.spec, LinearController.static(law.K)).bound <= most


@pytest.mark.slow
def test_the_search_goes_on_to_the_same_gain_from_either_side():
    case = CASES["AC15"]
    plant, spec, _ = case
    F = best_static_gain(plant, replace(spec, inputs=None)).F
    scaled = largest_kept(plant, spec, lambda t: t * F, halvings=2)
    law = best_linear_gain(case)
    ended = improved(case, scaled)
    assert scaled.bound > 2.5 and ended.bound == pytest.approx(1.21036, abs=1e-4)
    assert linear_cost(plant, spec, LinearController.static(law.K)).bound == pytest.approx(ended.bound, rel=1e-5)


def test_shares_of_the_limits_are_the_largest_over_the_vertices():
    case = Case(CASES["DIS2"].plant, replace(CASES["DIS2"].spec, initial=Box([-1.0, 0.5, -2.0], [0.0, 1.0, 3.0])), "")
    F = np.array([[-0.3, 0.2], [0.1, -0.7]])
    found = shares(case, case.spec.initial.support, F[None])[0].reshape(30, 4)  # type: ignore[arg-type]
    u = inputs(case, INC.linear(F), 30)
    expected = np.concatenate([u.max(axis=1), -u.min(axis=1)]) / 4.0
    assert found == pytest.approx(expected.T, abs=1e-10)


def test_the_best_linear_gain_is_the_paper_s_on_its_two_state_plant():
    case = two_state()
    found = linear_cost(case.plant, case.spec, LinearController.static(best_linear_gain(case).K))
    assert found.holds() and found.bound == pytest.approx(3.3472, abs=1e-4)


def test_the_scaled_regulator_costs_what_the_paper_prints():
    case = two_state()
    law = scaled_lqr(case)
    cost = linear_cost(case.plant, case.spec, LinearController.static(law.K)).bound
    assert cost == pytest.approx(3.5639, abs=1e-4)
    assert largest_share(case, law) == pytest.approx(1.0, abs=1e-6)


def test_the_scaled_regulator_is_a_multiple_of_the_regulator():
    case = CASES["pointer"]
    law, K = scaled_lqr(case), control_lqr_gain(case.plant, case.spec)
    ratios = (law.K / K).ravel()
    assert ratios == pytest.approx(np.full(2, ratios[0])) and 0 < ratios[0] < 1


@pytest.mark.slow
def test_where_scaling_down_lets_an_unstable_plant_grow_there_is_no_scaled_regulator():
    with pytest.raises(InfeasibleError, match="stabilizes the plant"):
        scaled_lqr(CASES["pendulum"])


def test_the_largest_member_of_a_family_is_found():
    case = scalar(0.9)
    found = largest_kept(case.plant, case.spec, lambda t: None if t > 0.9 else np.array([[-1.3 * t]]))
    assert found.controller.D_c[0, 0] == pytest.approx(-1.0, abs=1e-7)
    with pytest.raises(InfeasibleError, match="none of 5 gains"):
        largest_kept(case.plant, case.spec, lambda t: np.array([[t]]), values=5)


def test_a_gain_that_does_not_stabilize_or_keep_the_limits_is_not_certified():
    case = scalar(0.9)
    assert certified(case.plant, case.spec, np.array([[-1.0]])) is not None
    assert certified(case.plant, case.spec, np.array([[-1.001]])) is None  # |u| = 1.001
    assert certified(case.plant, case.spec, np.array([[-0.5]])) is None  # on the boundary of stability


@pytest.mark.parametrize("name", ["HE1", "REA1", "car, output"])
def test_the_filter_of_python_control_is_ours(name: str):
    plant, spec, _ = CASES[name]
    W, N = noise(plant, spec)
    gains = kalman(plant, W, N)
    assert gains.L == pytest.approx(observer_gain(plant, W, N), rel=1e-6, abs=1e-8)
    assert gains.L == pytest.approx(plant.A @ gains.M, abs=1e-9)
    ours = lqg(plant, spec, W, N, scaled=False)
    assert ours.D_c == pytest.approx(control_lqr_gain(plant, spec) @ gains.M, rel=1e-5, abs=1e-7)


def test_the_filter_in_continuous_time_is_its_limit():
    A, C = np.array([[0.0, 1.0], [-2.0, 0.3]]), np.array([[1.0, 0.0]])
    L, _, _ = control.lqe(A, np.eye(2), C, np.eye(2), np.eye(1))
    step = 1e-4
    plant = Plant(A, [[0.0], [1.0]], C, dt=0.0).sampled(step)
    assert kalman(plant, step * np.eye(2), np.eye(1) / step).L / step == pytest.approx(L, rel=1e-3)


def test_what_is_not_measured_cannot_be_estimated():
    with pytest.raises(InfeasibleError, match="does not show the mode 1.1"):
        saturated_lqg(BLIND)
    with pytest.raises(InfeasibleError, match="does not show the mode 1.1"):
        scaled_lqg(BLIND)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["embedding, output", "car, output", "NN2"])
def test_the_scaled_regulator_of_the_estimate_keeps_the_limits_and_comes_near_them(name: str):
    case = CASES[name]
    assert 0.9 < largest_share(case, scaled_lqg(case)) <= 1 + 1e-9


def test_the_saturated_regulator_clips_on_the_estimate_that_knows_the_clipped_input():
    case = CASES["business jet, output"]
    plant, spec, _ = case
    K, gains = control_lqr_gain(plant, spec), kalman(plant, *noise(plant, spec))
    x = spec.initial.vertices
    predicted, expected = np.zeros_like(x), []
    for _ in range(30):
        estimate = predicted + gains.M @ (plant.C @ x - plant.C @ predicted)
        u = np.clip(K @ estimate, -0.262, 0.262)
        expected.append(u)
        x, predicted = plant.A @ x + plant.B @ u, plant.A @ estimate + plant.B @ u
    assert inputs(case, saturated_lqg(case), 30) == pytest.approx(np.stack(expected, axis=-1), abs=1e-8)
    assert np.max(np.abs(expected)) == 0.262


def test_the_clipped_gain_is_the_best_without_limits():
    case = CASES["two lags, output"]
    law = clipped_gain(case)
    F = best_static_gain(case.plant, replace(case.spec, inputs=None)).F
    assert law([0.1]) == pytest.approx(F[0] * 0.1) and law([9.0]).tolist() == [-2.0]


def test_the_best_dynamic_controller_reaches_the_bound_of_its_class():
    case = two_state()
    found = linear_cost(case.plant, case.spec, best_dynamic(case))
    assert found.holds() and found.bound == pytest.approx(2.116763, abs=1e-5)  # affine_moves proves 2.116763


def test_more_moves_are_free_where_few_do_not_keep_the_limits():
    case = CASES["cruise"]  # braking from 25 m/s by closing the throttle takes more than 20 steps
    controller = best_dynamic(case)
    assert controller.order == 40 and largest_share(case, controller) <= 1 + 1e-9


def test_large_programs_are_made_smaller():
    assert work(CASES["six masses"], 20) > 3e8 > work(two_state(), 80)


@pytest.mark.parametrize("name", ["servo, output", "MFP"])
def test_the_predictive_law_minimizes_its_cost_under_the_limits(name: str):
    case = CASES[name]
    plant, spec, _ = case
    seen = Plant(plant.A, plant.B, dt=plant.dt)
    law = predictive(Case(seen, spec, ""))
    N, root = horizon(case), np.sqrt(spec.discount)
    P, _, _ = control.dare(root * plant.A, root * plant.B, spec.Q, spec.R)
    upper = spec.inputs.upper  # type: ignore[union-attr]
    x0 = np.array([0.9, -0.8, 0.3, 0.6]) * spec.initial.support.upper  # type: ignore[union-attr]

    def cost(v: np.ndarray) -> tuple[float, np.ndarray]:
        moves, x, total = v.reshape(N, plant.m) * upper, [x0], 0.0
        for k, u in enumerate(moves):
            total += spec.discount**k * (x[-1] @ spec.Q @ x[-1] + u @ spec.R @ u)
            x.append(plant.A @ x[-1] + plant.B @ u)
        total += spec.discount**N * (x[-1] @ P @ x[-1])
        slope, ahead = np.zeros((N, plant.m)), 2 * spec.discount**N * P @ x[-1]
        for k in reversed(range(N)):
            slope[k] = 2 * spec.discount**k * spec.R @ moves[k] + plant.B.T @ ahead
            ahead = 2 * spec.discount**k * spec.Q @ x[k] + plant.A.T @ ahead
        return total, (slope * upper).ravel()

    found = minimize(cost, np.zeros(N * plant.m), jac=True, method="L-BFGS-B", bounds=[(-1, 1)] * (N * plant.m),
                     options={"maxiter": 5000, "maxfun": 20000, "ftol": 1e-15, "gtol": 1e-10})
    assert law(x0) / upper == pytest.approx(found.x[: plant.m], abs=1e-3)
    assert law.q == N * plant.m <= 40


def test_the_horizon_ends_after_the_last_clipped_step():
    case = CASES["two lags"]
    plant, spec, _ = case
    K = control_lqr_gain(plant, spec)
    x, last = spec.initial.vertices, -1
    for k in range(200):
        wanted = K @ x
        last = k if np.max(np.abs(wanted)) > 2 else last
        x = plant.A @ x + plant.B @ np.clip(wanted, -2, 2)
    assert horizon(case) == last + 2 and 1 < last < 40


def test_the_horizon_is_one_where_nothing_is_clipped_and_is_cut_at_40_units():
    plant, spec, source = scalar(0.9, 0.05)
    assert horizon(Case(plant, replace(spec, inputs=Box(-9, 9)), source)) == 1
    assert horizon(CASES["MFP"]) * 3 == 39


def test_looking_ahead_costs_less_than_clipping_on_the_elastic_shaft():
    case = CASES["servo, output"]
    plant, spec, _ = case
    seen = Plant(plant.A, plant.B, dt=plant.dt)
    nodes = spec.initial.vertices
    K = control_lqr_gain(plant, spec)
    assert isinstance(spec.inputs, Box)
    clipped = INC.linear(K).with_saturated_output(spec.inputs)
    ahead = predictive(Case(seen, spec, ""))
    costs = [float(np.mean(simulate(seen, law, nodes, steps=300).cost(spec.Q, spec.R, spec.discount)))
             for law in (ahead, clipped)]
    assert costs[0] < 0.999 * costs[1]


def test_a_singular_input_cost_is_raised_a_little():
    plant, spec, source = scalar(0.9)
    law = predictive(Case(plant, spec, source))
    assert law([0.5]) == pytest.approx(-0.75, abs=1e-5) and law([1.0]) == pytest.approx(-1.0)


@pytest.mark.parametrize("baseline", ["saturated LQR", "MPC"])
def test_limits_that_are_no_box_are_refused(baseline: str):
    with pytest.raises(InvalidInputError, match="Box"):
        BASELINES[baseline](POLYTOPE, 0)
    with pytest.raises(InvalidInputError, match="Box"):
        clipped_gain(Case(replace(CASES["motor, output"].plant), replace(
            CASES["motor, output"].spec, inputs=Polytope([[1.0], [-1.0]], [1, 1])), ""))
