"""Wherever a Plant is accepted, so is a control.StateSpace, with the same answer: every public verb that takes a plant."""

import inspect

import control
import numpy as np
import pytest

import inc_casadi
from inc_casadi import (
    INC,
    MPC,
    Attraction,
    Box,
    Budget,
    DeviationCost,
    DiscountedCost,
    Invariance,
    L2Gain,
    Margins,
    Plant,
    Polytopic,
    Regional,
    Spec,
    Stability,
    bounds,
    dynamic,
    linear,
)
from inc_casadi.dynamic import certify_dynamic, corrected, observer, observer_gain
from inc_casadi.estimate import estimate
from inc_casadi.linear import LinearController
from synthesis import synthesize, synthesize_dynamic
from synthesis.alternation import alternate
from synthesis.compression import compress
from synthesis.dynamic_training import train_dynamic, with_units
from synthesis.gate import gate
from synthesis.training import train

A, B = np.array([[0.9, 0.3], [0.0, 0.8]]), np.array([[0.1], [0.5]])
LAW = INC.saturated([[-0.1, -0.3]], 1.0)
BOX, LIMITS = Box([-1.0, -1.0], [1.0, 1.0]), Box([-1.0], [1.0])
SPEC = Spec(np.eye(2), [[0.1]], 0.95, BOX, LIMITS)
REGIONAL = Regional(BOX, LIMITS, SPEC.Q, SPEC.R, 0.95)
NET = INC([[0.0]], [[0.1, 0.1]], [[-0.1]], [[-0.1, -0.2]])
DYNAMIC = observer(Plant(A, B), np.eye(2) * 0.5, corrected(LAW, np.eye(2) * 0.5, np.eye(2)))


def certified(claim, **options):
    def verb(plant):
        found = inc_casadi.certify(plant, LAW, claim, **options)
        return found.holds(), found.bound
    return verb


VERBS = {
    "close_loop": lambda plant: inc_casadi.close_loop(plant, LAW).F,
    "equilibrium": lambda plant: inc_casadi.equilibrium(plant, LAW).x,
    "simulate": lambda plant: inc_casadi.simulate(plant, LAW, [1.0, 0.5], steps=4).x,
    "estimate": lambda plant: estimate(plant, LAW, SPEC, samples=50).mean,
    "regions": lambda plant: inc_casadi.regions(plant, LAW, BOX).volumes,
    "reachable": lambda plant: inc_casadi.reachable(plant, LAW, BOX, 2).boxes,
    "region_of_attraction": lambda plant: inc_casadi.region_of_attraction(plant, LAW, BOX).share,
    "admissible_set": lambda plant: inc_casadi.admissible_set(plant, LAW, LIMITS, BOX).polytope.h,
    "largest_scale": lambda plant: (
        inc_casadi.largest_scale(plant, LAW, REGIONAL, tolerance=0.5, budget=Budget(seconds=5)).factor
    ),
    "MPC": lambda plant: MPC(plant, SPEC.Q, SPEC.R, 3, LIMITS).inc().U,
    "INC.from_mpc": lambda plant: INC.from_mpc(plant, SPEC.Q, SPEC.R, 3, LIMITS).U,
    "Polytopic": lambda plant: Polytopic(Stability(0.99), (plant,)).plants[0].A,
    "certify: Stability": certified(Stability(0.99), multiplier="sector"),
    "certify: Margins": certified(Margins(), multiplier="sector"),
    "certify: DiscountedCost": certified(DiscountedCost(SPEC.Q, SPEC.R, 0.95, SPEC.initial), multiplier="sector"),
    "certify: DeviationCost": certified(DeviationCost(SPEC.Q, SPEC.R, 0.95, SPEC.initial), multiplier="sector"),
    "certify: L2Gain": certified(L2Gain([[1.0], [0.0]]), multiplier="sector"),
    "certify: Regional": certified(REGIONAL),
    "certify: Attraction": certified(Attraction(LIMITS)),
    "certify: Invariance": certified(Invariance(BOX, LIMITS)),
    "compare": lambda plant: [row.bound for row in inc_casadi.compare(plant, SPEC, {"ours": LAW}, bounds=["linear"]).rows],
    "bounds.first_move": lambda plant: float(bounds.first_move(plant, SPEC)),
    "bounds.affine_moves": lambda plant: float(bounds.affine_moves(plant, SPEC, 3)),
    "bounds.any_controller": lambda plant: float(bounds.any_controller(plant, SPEC, cells=50)),
    "bounds.any_output_feedback": lambda plant: float(bounds.any_output_feedback(plant, SPEC, cells=50)),
    "bounds.static_output_feedback": lambda plant: float(bounds.static_output_feedback(plant, SPEC, gap=0.2)),
    "bounds.uncontrollable_vertex": lambda plant: bounds.uncontrollable_vertex(plant, SPEC) or 0.0,
    "linear.best_dynamic_linear": lambda plant: linear.best_dynamic_linear(plant, SPEC, 3).bound,
    "linear.best_static_gain": lambda plant: linear.best_static_gain(plant, SPEC, starts=1).F,
    "linear.scaled_lqr_gain": lambda plant: linear.scaled_lqr_gain(plant, SPEC).F,
    "linear.discounted_lqr": lambda plant: linear.discounted_lqr(plant, SPEC)[0],
    "linear.damped_plant": lambda plant: linear.damped_plant(plant, SPEC).A,
    "linear.dynamic_loop": lambda plant: linear.dynamic_loop(plant, LinearController.static([[0.1, 0.1]])).A,
    "linear.linear_cost": lambda plant: linear.linear_cost(plant, SPEC, LinearController.static([[-0.1, -0.1]])).bound,
    "linear.best_kept_gain": lambda plant: linear.best_kept_gain(plant, SPEC, starts=1).bound,
    "linear.unswitched_cost": lambda plant: linear.unswitched_cost(plant, SPEC, LAW).bound,
    "linear.clipped_cost": lambda plant: linear.clipped_cost(plant, SPEC, LAW).bound,
    "linear.lqg": lambda plant: linear.lqg(plant, SPEC).A_c,
    "dynamic.observer": lambda plant: observer(plant, np.eye(2), LAW).law.K,
    "dynamic.observer_gain": lambda plant: observer_gain(plant, np.eye(2), np.eye(2)),
    "dynamic.filter_gains": lambda plant: dynamic.filter_gains(plant, SPEC, 2),
    "dynamic.scheduled_observer": lambda plant: dynamic.scheduled_observer(plant, SPEC, LAW, [np.eye(2)], np.eye(2)).law.K,
    "dynamic.extended": lambda plant: dynamic.extended(plant, DYNAMIC)[0].A,
    "dynamic.folded": lambda plant: dynamic.folded(plant, DYNAMIC, REGIONAL, Box([-9.0, -9.0], [9.0, 9.0])).plant.A,
    "dynamic.certify_dynamic": lambda plant: certify_dynamic(plant, DYNAMIC, REGIONAL).bound,
    "dynamic.extended_spec": None,  # takes none
    "Plant.from_control": lambda plant: Plant.from_control(plant.to_control() if isinstance(plant, Plant) else plant).A,
}
SYNTHESIS = {
    "synthesize": lambda plant: synthesize(plant, SPEC, hidden=0, verbose=False).cost,
    "synthesize from a regulator of theirs": lambda plant: (
        synthesize(
            plant, SPEC, hidden=0, verbose=False, starts=[], start=INC.from_lqr(control.dlqr(A, B, SPEC.Q, SPEC.R), LIMITS)
        ).cost
    ),
    "synthesize_dynamic": lambda plant: (
        synthesize_dynamic(plant, SPEC, hidden=0, rounds=1, starts=["kept gain"], verbose=False).cost
    ),
    "train": lambda plant: train(plant, SPEC, NET, max_iterations=2).inc.U,
    "train_dynamic": lambda plant: train_dynamic(plant, SPEC, DYNAMIC, max_iterations=1).dynamic.law.U,
    "with_units": lambda plant: with_units(plant, SPEC, DYNAMIC, 1).law.U,
    "alternate": lambda plant: alternate(plant, NET, DiscountedCost(SPEC.Q, SPEC.R, 0.95, SPEC.initial), max_rounds=1).inc.U,
    "compress": lambda plant: compress(plant, SPEC, LAW, 1).inc.U,
    "gate": lambda plant: gate(plant, SPEC, LAW).cost,
}


def plants(dt):
    return Plant(A, B, dt=dt), control.ss(A, B, np.eye(2), np.zeros((2, 1)), dt)


def agree(verb, dt):
    ours, theirs = (verb(plant) for plant in plants(dt))
    np.testing.assert_allclose(np.asarray(theirs, dtype=float), np.asarray(ours, dtype=float), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", [name for name, verb in VERBS.items() if verb is not None])
def test_a_state_space_of_unspecified_period_is_as_good(name):
    agree(VERBS[name], True)


@pytest.mark.parametrize("name", ["simulate", "certify: Regional", "compare", "dynamic.certify_dynamic"])
def test_a_sampling_period_is_kept(name):
    agree(VERBS[name], 0.5)
    assert inc_casadi.simulate(plants(0.5)[1], LAW, [1.0, 0.5], steps=2).t.tolist() == [0.0, 0.5, 1.0]


@pytest.mark.slow
@pytest.mark.parametrize("name", SYNTHESIS)
def test_synthesis_takes_a_state_space(name):
    agree(SYNTHESIS[name], True)


def test_continuous_time_too():
    A, B = [[-1.0, 0.3], [0.0, -2.0]], [[0.1], [0.5]]
    ours, theirs = (inc_casadi.certify(plant, LAW, Stability(0.5), multiplier="sector")
                    for plant in (Plant(A, B, dt=0), control.ss(A, B, np.eye(2), np.zeros((2, 1)))))
    assert theirs.holds() and theirs.bound == ours.bound and not theirs.plant.discrete


def test_no_public_verb_that_takes_a_plant_is_missing_from_the_table():
    """What the packages export with a parameter `plant` is tried above, by its own name or one that begins with it."""
    tried = {name.partition(":")[0] for name in VERBS}
    for place, module in (("", inc_casadi), ("bounds.", bounds), ("linear.", linear), ("dynamic.", dynamic)):
        for name in module.__all__:
            verb = getattr(module, name)
            if inspect.isfunction(verb) and "plant" in inspect.signature(verb).parameters:
                assert place + name in tried, f"{place}{name} takes a plant, but no test gives it a control.StateSpace"
