"""Ellipsoidal regions: sampled motions keep what is claimed, broken certificates are refused, bounds by hand."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.plants.paper import two_state
from inc_casadi import (
    INC,
    Attraction,
    Box,
    Ellipsoid,
    Empirical,
    Gaussian,
    Logistic,
    Plant,
    Regional,
    Spec,
    Tanh,
    Uniform,
    certify,
    load,
    simulate,
)
from inc_casadi.ellipsoidal_region import EllipsoidalRegion, certify_ellipsoidal
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.linear import discounted_lqr
from inc_casadi.pieces.walk import Budget

CASE, UNIT, TANH = two_state(), Box(-1, 1), Tanh()


def net(units=TANH, bias=0.0, seed=0):
    """A saturated net on the paper's unstable plant, with about its LQR's slope at rest."""
    rng = np.random.default_rng(seed)
    K, _ = discounted_lqr(CASE.plant, CASE.spec)
    U, b = 0.5 * rng.normal(size=(4, 2)), bias * rng.normal(size=4)
    slope = np.array([float(units.derivative(entry)) for entry in b])
    law = INC(np.zeros((4, 4)), U, K @ np.linalg.pinv(slope[:, None] * U), np.zeros((1, 2)), b, activation=units)
    return replace(law, d=-law([0.0, 0.0])).with_saturated_output(UNIT)


def asked(initial, discount=0.98):
    return Spec(np.eye(2), 0.05, discount, initial, UNIT)


def costs(law, spec, x, steps=600):
    """Costs of motions from columns x (2, N), counted as the specification says, and the run."""
    run = simulate(CASE.plant, law, x, steps=steps)
    stage = np.sum(run.x**2, axis=0) + 0.05 * run.u[0] ** 2
    return stage @ spec.discount ** np.arange(steps + 1), run


SETS = {"box": Box([-0.35, -0.35], [0.35, 0.35]), "shifted": Box([-0.1, 0.0], [0.4, 0.3]),
        "ellipsoid": Ellipsoid([[9.0, 2.0], [2.0, 7.0]], center=[0.1, 0.05])}


@pytest.fixture(scope="module")
def boxed():
    """The net that preserves the origin, from the box."""
    found = certify_ellipsoidal(CASE.plant, net(), asked(SETS["box"]))
    assert found.holds(), found.reason
    return found


@pytest.fixture(scope="module", params=[("box", Tanh(), 0.0), ("shifted", Tanh(), 0.3), ("ellipsoid", Logistic(), 0.2)],
                ids=["tanh in a box", "tanh with biases, off center", "logistic in an ellipsoid"])
def region(request):
    name, units, bias = request.param
    found = certify_ellipsoidal(CASE.plant, net(units, bias), asked(SETS[name]))
    assert found.holds(), found.reason
    return found


def test_sampled_motions_stay_inside_arrive_and_cost_no_more(region):
    rng = np.random.default_rng(1)
    x = region.spec.initial.sample(2000, rng)
    if not isinstance(region.spec.initial.support, Ellipsoid):
        x = np.hstack([x, region.spec.initial.vertices])
    cost, run = costs(region.inc, region.spec, x)
    e = run.x - region.ellipsoid.center[:, None, None]
    V = np.einsum("int,ij,jnt->nt", e, region.ellipsoid.P, e)
    assert np.all(V <= 1 + 1e-9) and np.max(V[:, -1]) < 1e-9 and np.all(np.abs(run.u) <= 1)
    assert np.mean(cost[:2000]) < region.bound < 1.5 * np.mean(cost[:2000])
    assert np.max(cost) <= region.worst_bound < 4 * np.max(cost)


def test_it_is_proved_and_says_what(region):
    assert region.prove().succeeded and region.require() is region
    assert f"{region.bound:.4g}"[:4] in region.sentence and "every input stays within its limits" in region.sentence


def test_a_smaller_ellipsoid_that_does_not_contain_the_initial_set_is_refused(region):
    values = {name: entry * (2 if name in ("P", "Lambda") else 1) for name, entry in region.inner.values.items()}
    shrunk = replace(region, evidence=replace(region.evidence, values=values))
    assert shrunk.inner.holds() and region.margins()["contained"] >= 0 > shrunk.margins()["contained"]
    assert "scaled by 0.7" in shrunk.reason and not shrunk.prove() and not shrunk.holds()


def test_an_initial_set_that_is_a_millionth_too_large_is_refused(boxed):
    P, corner = boxed.inner.values["P"], SETS["box"].upper
    vertices = SETS["box"].vertices
    reach = np.max(np.einsum("in,ij,jn->n", vertices, P, vertices)) ** -0.5
    inside, beyond = (replace(boxed, spec=asked(Box(-s * reach * corner, s * reach * corner))) for s in (1 - 1e-9, 1 + 1e-6))
    assert inside.holds() and inside.prove()
    assert not beyond.holds() and not beyond.prove() and "scaled by 0.99999" in beyond.reason


@pytest.mark.parametrize(("name", "factor"), [("P", 0.5), ("P_cost", 0.8), ("Lambda", -1.0), ("Lambda_cost", 10.0),
                                              ("r", 0.5)])
def test_corrupted_numbers_are_refused(boxed, name, factor):
    values = {**boxed.inner.values, name: factor * boxed.inner.values[name]}
    broken = replace(boxed, evidence=replace(boxed.evidence, values=values))
    assert not broken.holds() and not broken.prove()


def test_the_claim_is_that_of_the_specification_whatever_the_evidence_was_found_for(boxed):
    lax = replace(boxed.evidence, claim=Attraction(Q=0.0 * np.eye(2), R=[[0.0]]))
    assert replace(boxed, evidence=lax).inner.claim.Q.tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert not replace(boxed, spec=Spec(2 * np.eye(2), 0.05, 0.98, SETS["box"], UNIT)).holds()
    with pytest.raises(InvalidInputError, match="Lambda_inputs"):  # limits that are no longer built in ask for numbers
        replace(boxed, spec=Spec(np.eye(2), 0.05, 0.98, SETS["box"], Box(-0.5, 0.5)))


def test_a_linear_loop_costs_what_its_lyapunov_equation_says():
    gain, start = np.array([[-0.3, -0.8]]), Box([-0.1, -0.1], [0.1, 0.1])
    law = INC.saturated(gain, 1.0)
    found = certify_ellipsoidal(CASE.plant, law, asked(start))
    closed = CASE.plant.A + CASE.plant.B @ gain
    P, power = np.zeros((2, 2)), np.eye(2)
    for k in range(3000):
        P += 0.98**k * power.T @ (np.eye(2) + 0.05 * gain.T @ gain) @ power
        power = closed @ power
    assert found.bound == pytest.approx(np.trace(P) * 0.01 / 3, rel=1e-3) and found.bound >= np.trace(P) * 0.01 / 3
    corners = start.vertices
    assert found.worst_bound == pytest.approx(np.max(np.einsum("in,ij,jn->n", corners, P, corners)), rel=1e-2)


def test_limits_that_are_not_built_in_are_kept_by_the_ellipsoid():
    law = replace(net(), V=1.5 * net().V)  # gives up to 1.5
    found = certify_ellipsoidal(CASE.plant, law, asked(Box([-0.1, -0.1], [0.1, 0.1])))
    assert found.holds(), found.reason
    e = found.ellipsoid.sample(3000, np.random.default_rng(0))
    assert np.all(np.abs(costs(law, found.spec, e, 50)[1].u) <= 1)


def test_a_rest_away_from_the_origin_is_paid_for():
    law = INC([[0.0]], [[1.6]], [[-1.0]], [[0.0]], d=[0.05], activation=Tanh())  # rests at x* != 0 with u* = -0.5 x*
    plant, spec = Plant(1.5, 1.0), Spec(1.0, 0.1, 0.9, Box(-0.5, 0.5))
    found = certify_ellipsoidal(plant, law, spec)
    assert found.holds(), found.reason
    assert found.prove() and abs(found.ellipsoid.center[0]) > 0.04
    x, total = spec.initial.sample(20_000, np.random.default_rng(0)), 0.0
    for k in range(300):
        u = law(x)
        total = total + 0.9**k * (x[0] ** 2 + 0.1 * u[0] ** 2)
        x = plant.A @ x + plant.B @ u
    assert total.mean() < found.bound < 2.5 * total.mean() and total.max() <= found.worst_bound
    assert "without discount" in certify_ellipsoidal(plant, law, Spec(1.0, 0.1, 1.0, Box(-0.5, 0.5))).reason


def test_without_discount_a_law_at_rest_at_the_origin_is_certified():
    assert certify_ellipsoidal(CASE.plant, net(), asked(SETS["box"], discount=1.0)).prove()


def test_finitely_many_initial_states_are_contained_too():
    points = Empirical([[0.3, -0.2, 0.1], [0.1, 0.2, -0.3]])
    found = certify_ellipsoidal(CASE.plant, net(), asked(points))
    cost, _ = costs(found.inc, found.spec, np.array(points.vertices))
    assert found.holds() and cost.mean() < found.bound < 1.5 * cost.mean()


@pytest.mark.slow
@pytest.mark.parametrize(("law", "spec", "words"), [
    (net(), asked(Box([-2, -2], [2, 2])), "contains the initial set scaled by 0."),
    (net(), asked(Gaussian([0, 0], np.eye(2))), "unbounded"),
    (replace(net(), V=-net().V), asked(SETS["box"]), "linearization"),
    (replace(net(), W=3.0 * np.eye(5)), asked(SETS["box"]), "not well posed"),
], ids=["too large", "unbounded", "unstable", "ill posed"])
def test_what_stands_in_the_way_is_said(law, spec, words):
    found = certify_ellipsoidal(CASE.plant, law, spec)
    assert words in found.reason and not found.holds() and not found.prove() and found.bound == np.inf
    assert found.sentence.startswith("Not certified")


def test_no_time_is_a_reason():
    assert "time limit" in certify_ellipsoidal(CASE.plant, net(), asked(SETS["box"]), 0.0).reason


def test_arguments_that_do_not_fit_are_refused():
    with pytest.raises(DimensionError):
        certify_ellipsoidal(Plant(1.5, 1.0), INC.saturated([[-1.5]], 1.0), asked(SETS["box"]))
    with pytest.raises(InvalidInputError, match="discrete"):
        certify_ellipsoidal(Plant(CASE.plant.A, CASE.plant.B, dt=0.0), net(), asked(SETS["box"]))
    with pytest.raises(InvalidInputError, match="Spec"):
        EllipsoidalRegion(3, 4)


def test_certify_takes_it_as_a_method_of_a_regional_claim_and_files_keep_it(tmp_path):
    claim = Regional(Uniform(SETS["box"]), UNIT, np.eye(2), 0.05, 0.98)
    found = certify(CASE.plant, net(), claim, method="ellipsoid", budget=Budget(seconds=60.0))
    assert isinstance(found, EllipsoidalRegion) and found.holds()
    found.save(tmp_path / "region.json")
    again = load(tmp_path / "region.json")
    assert again.holds() and again.bound == found.bound
    with pytest.raises(InvalidInputError, match="'pieces' or 'ellipsoid'"):
        certify(CASE.plant, net(), claim, method="dead zone")
