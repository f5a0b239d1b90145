"""Controllers with memory as rows: certified where their pieces are, by an ellipsoid where units curve, or simulated."""

from dataclasses import replace

import numpy as np
import pytest

from inc_casadi import INC, Box, Gaussian, Plant, Spec, Tanh, compare, load, save
from inc_casadi.dynamic import DynamicINC, observer, observer_gain
from inc_casadi.errors import DimensionError
from inc_casadi.interchange.agreement import disagreement
from inc_casadi.linear import discounted_lqr
from inc_casadi.linear.controller import LinearController
from inc_casadi.pieces.walk import Budget

PLANT = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
SPEC = Spec(np.eye(2), 0.1, 0.95, Box([-1.0, -0.5], [1.0, 0.5]), Box(-0.5, 0.5))
L = observer_gain(PLANT, np.eye(2), 1.0)
FULL = Plant(PLANT.A, PLANT.B)


def clipped(readout=None):
    K, _ = discounted_lqr(FULL, Spec(SPEC.Q, SPEC.R, SPEC.discount, SPEC.initial))
    return observer(PLANT, L, readout or INC.linear(K).with_saturated_output(SPEC.inputs))


def row_of(controller, spec=SPEC, plant=PLANT, **more):
    return compare(plant, spec, {"it": controller}, bounds=[], samples=4000, **more).row("it")


def costs(controller, x, steps=400):
    xi, total, most = np.repeat(controller.xi_0[:, None], x.shape[1], axis=1), np.zeros(x.shape[1]), 0.0
    for k in range(steps):
        xi, u = controller.step(xi, PLANT.C @ x)
        total, most = total + 0.95**k * (np.sum(x**2, axis=0) + 0.1 * u[0] ** 2), max(most, float(np.max(np.abs(u))))
        x = PLANT.A @ x + PLANT.B @ u
    return total, most


def test_a_clipped_observer_is_certified_with_what_its_motions_cost():
    row = row_of(clipped())
    total, most = costs(clipped(), SPEC.initial.sample(40_000, np.random.default_rng(0)))
    assert row.certified and row.family.key == "any" and row.kind == "dynamic, order 2, 1 unit" and most <= 0.5
    assert row.bound == pytest.approx(total.mean(), abs=5 * total.std() / 200)
    assert row.converges.verdict == row.limits.verdict == "certified" and row.worst > total.max()


def test_it_is_set_beside_the_bound_on_every_controller():
    shown = compare(PLANT, SPEC, {"LQG clipped": clipped()}, bounds=["any"], cells=200)
    assert 0 < shown.gap("LQG clipped") < np.inf and shown.inversions() == ()


def test_without_hidden_units_it_is_the_linear_controller_that_it_is():
    lag = LinearController([[0.3, 0.1], [0.0, 0.2]], [[0.1], [0.3]], [[0.2, 0.1]], [[-0.5]], [0.05, -0.1])
    plant, spec = Plant(1.2, 1.0), Spec(1.0, 0.1, 0.95, Box(-0.5, 0.5), Box(-1, 1))
    rows = [row_of(controller, spec, plant) for controller in (lag, DynamicINC.from_linear(lag))]
    assert rows[0].bound == rows[1].bound < np.inf and {row.family.key for row in rows} == {"linear"}
    assert rows[1].limits.verdict == "certified" and rows[1].kind == "dynamic linear, order 2"


def test_a_curved_readout_is_certified_by_an_ellipsoid_of_plant_and_observer(tmp_path):
    K, _ = discounted_lqr(FULL, Spec(SPEC.Q, SPEC.R, SPEC.discount, SPEC.initial))
    soft = INC([[0.0]], 2.0 * K, [[0.5]], [[0.0, 0.0]], activation=Tanh())
    small = Spec(SPEC.Q, SPEC.R, 0.95, Box([-0.1, -0.05], [0.1, 0.05]), SPEC.inputs)
    found = compare(PLANT, small, {"it": clipped(soft)}, bounds=[])
    row = found.row("it")
    save(found, tmp_path / "found.json")
    assert str(load(tmp_path / "found.json")) == str(found)
    other = replace(found, spec=replace(small, discount=0.9))
    assert "another specification" in disagreement(other)
    total, _ = costs(clipped(soft), small.initial.sample(4000, np.random.default_rng(0)))
    assert row.certified, row.notes
    assert total.mean() < row.bound < 2 * total.mean() and total.max() <= row.worst and "ellipsoid" in row.cost.words


def test_where_nothing_is_certified_it_is_simulated_with_its_limits():
    spec = Spec(SPEC.Q, SPEC.R, 0.95, SPEC.initial, Box(-0.3, 0.3))  # tighter than the readout keeps
    row = row_of(clipped(), spec, budget=Budget(seconds=5.0))
    total, most = costs(clipped(), spec.initial.sample(4000, np.random.default_rng(0)))
    assert not row.certified and row.limits.verdict == "violated" and f"{most - 0.3:.2f}"[:3] in row.limits.reason
    assert row.cost.how == "simulated" and row.cost.value == pytest.approx(total.mean(), rel=0.05)
    normal = row_of(clipped(), Spec(SPEC.Q, SPEC.R, 0.95, Gaussian([0, 0], 0.01 * np.eye(2)), SPEC.inputs))
    assert normal.limits.verdict == "seen in simulation" and "not uniform" in normal.notes[0]


def test_what_does_not_fit_or_is_ill_posed_is_named():
    with pytest.raises(DimensionError, match="'it' reads 1"):
        compare(FULL, SPEC, {"it": clipped()}, bounds=[])
    loop = DynamicINC.from_matrices(A_c=[[0.0]], B_c=[[1.0]], C_c=[[0.0]], K=[[0.0]], W=[[2.0]], U=[[1.0]], S=[[0.0]],
                                    V=[[-1.0]], E_c=[[0.0]])
    assert "not proved well posed" in row_of(loop).notes[0]
