"""The certificate of seldom clipped laws: every bound of every move on sampled motions, exact costs, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    Ellipsoid,
    Empirical,
    Gaussian,
    LeakyReLU,
    Plant,
    Polytope,
    Regional,
    Saturation,
    Spec,
    Uniform,
    certify,
    load,
    save,
    simulate,
)
from inc_casadi.linear.clipped_cost import ClippedCost, clipped_cost
from inc_casadi.linear.unswitched_cost import unswitched_cost

SCALAR, UNIT = Plant(1.5, 1.0), Box(-1, 1)
PLANT = Plant([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.1], [0.0, 0.2, 0.8]], [[0.0, 0.1], [1.0, 0.0], [0.0, 0.7]],
              [[1.0, 0.2, 0.0], [0.0, 1.0, 0.0], [0.3, 0.0, 1.0], [0.0, 0.5, 0.5]])
K = np.array([[-0.45, -0.35, 0.05, -0.1], [-0.1, 0.05, -0.2, 0.1]])
LIMITS = Box([-0.5, -0.25], [0.25, 0.5])
LAW = INC(np.zeros((2, 2)), K / [[0.5], [0.25]], np.diag([0.5, 0.25]), np.zeros((2, 4)), activation=Saturation())
NET = INC(np.zeros((3, 3)), [[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 0.5, 0.0], [0.5, 0.0, 0.0, 1.0]],
          [[-0.25, -0.125, 0.0], [0.0625, 0.0, -0.125]], 0.8 * K, b=[0.25, 0.5, -0.25], d=[0.125, -0.046875],
          activation=(LeakyReLU(0.5), LeakyReLU(0.25), Saturation()))
BOX = Uniform(Box([-0.7, -0.5, -0.4], [0.6, 0.5, 0.8]))
BALL = Uniform(Ellipsoid(4 * np.diag([1.0, 2.0, 3.0]), [0.05, 0.0, -0.1]))
WEDGE = Uniform(Polytope.from_vertices(BOX.vertices[:, [0, 1, 2, 4, 7]]))


def spec(initial=BOX, inputs=None, discount=0.95):
    return Spec(np.diag([1.0, 0.5, 2.0]), [[0.3, 0.1], [0.1, 0.4]], discount, initial, inputs)


def costs(asked, law, x, steps=120):
    motion = simulate(PLANT, law, x, steps=steps)
    states, inputs = motion.x[..., :steps], motion.u[..., :steps]
    stage = (np.einsum("i...k,ij,j...k->...k", states, asked.Q, states)
             + np.einsum("i...k,ij,j...k->...k", inputs, asked.R, inputs))
    return stage @ asked.discount ** np.arange(steps)


@pytest.mark.parametrize("law, inputs", [(LAW, Box([-0.5, -0.25], [0.5, 0.25])), (NET, None)], ids=["clipped", "network"])
@pytest.mark.parametrize("initial", [BOX, BALL, WEDGE], ids=["box", "ball", "wedge"])
def test_every_move_of_every_motion_is_within_its_bounds(law, inputs, initial):
    asked = spec(initial, inputs)
    found = clipped_cost(PLANT, asked, law)
    assert found.holds() and found.prove(), found.reason
    x = initial.sample(20_000, np.random.default_rng(0))
    x = x if initial is BALL else np.hstack([x, initial.vertices])
    moves = len(found.clipping.most)
    motion = simulate(PLANT, law, x, steps=moves + 5).x
    gain = law.jacobian(np.zeros(4))
    L = found._parts.L.value
    for k in range(moves + 5):
        y = PLANT.C @ motion[..., k]
        d = np.linalg.lstsq(law.V[:, list(found.loop.units)], gain @ y - law(y), rcond=None)[0] if law is LAW else None
        if law is NET:  # the units one by one: what each differs from its affine piece
            z = law.U @ y + law.b[:, None]
            d = z - np.stack([unit.formula(row, np) for unit, row in zip(law.activations, z, strict=True)])
        if k >= moves:
            assert np.max(np.abs(d)) < 1e-12
            continue
        assert np.all(np.max(np.abs(d), axis=1) <= found.clipping.most[k] + 1e-12)
        assert np.all(np.mean(np.abs(d[:, :20_000]), axis=1) <= 1.02 * found.clipping.first[k] + 1e-12)
        assert np.all(np.sqrt(np.mean(d[:, :20_000] ** 2, axis=1)) <= 1.05 * found.clipping.second[k] + 1e-12)
        assert np.all(np.max(np.abs(L @ motion[..., k]), axis=1) <= found.clipping.along[k] + 1e-12)


@pytest.mark.parametrize("law, inputs", [(LAW, Box([-0.5, -0.25], [0.5, 0.25])), (NET, None)], ids=["clipped", "network"])
def test_the_bound_is_above_the_sampled_cost_and_near(law, inputs):
    asked = spec(inputs=inputs)
    found = clipped_cost(PLANT, asked, law)
    seen = costs(asked, law, BOX.sample(4_000, np.random.default_rng(1)))
    assert np.max(np.abs(law(PLANT.C @ BOX.vertices) - law.jacobian(np.zeros(4)) @ PLANT.C @ BOX.vertices)) > 0.01
    assert seen.mean() - 4 * seen.std() / 63 <= found.bound <= 1.1 * seen.mean()
    assert max(costs(asked, law, BOX.vertices)) <= found.worst_bound


@pytest.mark.parametrize("gain", [-1.05, -1.2, -1.35])
def test_it_is_above_the_exact_cost(gain):
    asked, law = Spec(1.0, 0.1, 0.9, UNIT, UNIT), INC.saturated([[gain]], 1.0)
    exact = certify(SCALAR, law, Regional(asked.initial, asked.inputs, asked.Q, asked.R, asked.discount))
    found = clipped_cost(SCALAR, asked, law)
    assert exact.holds() and found.holds() and exact.expected <= found.bound <= 1.25 * exact.expected
    assert exact.worst_bound <= found.worst_bound * (1 + 1e-12)


def test_what_is_never_clipped_costs_what_the_linear_loop_does():
    asked = spec(Box([-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]))
    found = clipped_cost(PLANT, asked, LAW)
    assert found.bound == pytest.approx(unswitched_cost(PLANT, asked, LAW).bound, rel=1e-10)
    assert not found.clipping.most.any()


SHORT = Spec(1.0, 0.1, 0.9, UNIT, UNIT)


@pytest.mark.parametrize("law, asked, why", [
    (INC.saturated([[-0.4]], 1.0), SHORT, "not stable"),
    (INC.saturated([[-1.5]], 1.0), Spec(1.0, 0.1, 0.9, Box(-2.5, 2.5), UNIT), "more and more"),
    (INC.linear([[-1.2]]), SHORT, "not built into"),
    (INC([[0.5]], [[-1.0]], [[1.0]], [[0.0]], activation=Saturation()), SHORT, "single layer"),
    (INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], b=[0.1], activation=Saturation()), SHORT, "at y = 0"),
    (INC.saturated([[-1.2]], 1.0), Spec(1.0, 0.1, 0.9, Gaussian([0.0], [[1.0]]), UNIT), "")])
def test_refusals_name_what_fails(law, asked, why):
    found = clipped_cost(SCALAR, asked, law)
    assert not found.holds() and not found.prove() and why in found.reason and found.bound == np.inf
    assert found.sentence.startswith("Not certified")


@pytest.mark.parametrize("name, factor", [("P", 1 - 1e-6), ("P", -1.0), ("W", 0.5), ("W", -1.0), ("W", 1e-3)])
def test_corrupted_numbers_are_refused(name, factor):
    found = clipped_cost(PLANT, spec(inputs=Box([-0.5, -0.25], [0.5, 0.25])), LAW)
    bad = replace(found, **{name: factor * getattr(found, name)})
    assert found.holds() and not bad.holds() and not bad.prove()


def test_the_certificate_of_another_law_or_plant_is_refused():
    found = clipped_cost(PLANT, spec(inputs=None), NET)
    for change in ({"plant": replace(PLANT, A=1.05 * PLANT.A)}, {"spec": replace(found.spec, Q=1.01 * found.spec.Q)}):
        assert not replace(found, **change).holds()


def test_it_is_kept_in_a_file(tmp_path):
    found = clipped_cost(PLANT, spec(inputs=None), NET)
    save(found, tmp_path / "found.json")
    again = load(tmp_path / "found.json")
    assert isinstance(again, ClippedCost) and again.prove() and again.bound == found.bound


def test_initial_states_that_lie_unevenly_about_their_mean():
    """From -1, the farthest from the mean of -1, 1/5 and 3/10, the unit is beyond its kink by 3/10."""
    found = clipped_cost(SCALAR, replace(SHORT, initial=Empirical([[-1.0, 0.2, 0.3]])), INC.saturated([[-1.3]], 1.0))
    assert found.holds() and found.clipping.most[0, 0] >= 0.3
