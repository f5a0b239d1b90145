"""Laws that do not settle are found out, and mended by giving way to a gain that does, or said not to settle."""

import numpy as np
import pytest

from benchmarks.plants.oscillators import masses
from inc_casadi import INC, Box, Plant, ReLU, Spec
from inc_casadi.linear import discounted_lqr
from synthesis import compression
from synthesis.compression import compress
from synthesis.settling import SHARES, Rest, gives_way, local_gain, rest
from synthesis.starts.imitation import Imitation

STEEP = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
SPEC = Spec(np.eye(2), 0.05, 0.9, Box([-0.6, -0.6], [0.6, 0.6]), Box(-1, 1))
TEACHER = INC.from_mpc(STEEP, SPEC.Q, SPEC.R, 4, SPEC.inputs, discount=0.9)


def wild(seed, q=3, size=2.0):
    """A law whose units push away from the origin."""
    rng = np.random.default_rng(seed)
    W = rng.uniform(-1, 1, (q, q))
    U, V = rng.standard_normal((q, 2)), size * rng.standard_normal((1, q))
    return INC(0.4 * W / np.abs(W).sum(axis=1, keepdims=True), U, V, [[1.0, 2.0]], rng.uniform(0.2, 0.5, q))


def fits_in_vain(monkeypatch):
    """Imitation that learns nothing."""
    monkeypatch.setattr(compression, "imitate", lambda plant, spec, taught, start, *rest: Imitation(start, 1.0, 1.0, "vain"))


@pytest.mark.parametrize("gain, settles", [([[-0.2, -0.1]], False), ([[-1.0, -2.0]], True)])
def test_what_is_said_of_a_linear_law_is_what_its_eigenvalues_say(gain, settles):
    seen = rest(STEEP, SPEC, INC.linear(gain))
    radius = np.max(np.abs(np.linalg.eigvals(STEEP.A + STEEP.B @ np.array(gain))))
    assert seen.radius == pytest.approx(radius) and seen.holds == settles == (radius < 1)
    assert ("does not settle" in seen.sentence) != settles


@pytest.mark.parametrize("settled, radius, holds", [(True, 0.9, True), (True, 1.0, False), (False, 0.9, False),
                                                    (True, np.nan, True), (False, np.nan, False)])
def test_nothing_may_speak_against_rest(settled, radius, holds):
    assert Rest(settled, radius).holds == holds and ("does not settle" in Rest(settled, radius).sentence) != holds


def test_motions_that_end_on_a_cycle_do_not_settle():
    """x+ = -x where |u| is at its limit: no eigenvalue at the origin says so."""
    plant, far = Plant([[-1.0]], [[1.0]]), Spec([[1.0]], [[1.0]], 0.9, Box([2.0], [3.0]))
    law = INC([[0.0]], [[1.0]], [[0.0]], [[0.0]])
    assert not rest(plant, far, law).holds


def test_a_law_beside_the_origin_is_judged_by_its_motions_alone():
    plant, spec = Plant([[0.5]], [[1.0]]), Spec([[1.0]], [[1.0]], 0.9, Box([-1.0], [1.0]))
    seen = rest(plant, spec, INC([[0.0]], [[0.0]], [[0.0]], [[0.0]], d=[0.3]))
    assert np.isnan(seen.radius) and seen.holds


@pytest.mark.parametrize("seed", range(3))
def test_every_mixture_has_the_gain_at_the_origin_and_the_last_is_the_gain(seed):
    F, law = np.array([[-1.0, -2.0]]), wild(seed)
    mixtures = list(gives_way(law, F))
    y = np.random.default_rng(seed).standard_normal((2, 50))
    for share, one in zip(SHARES, mixtures, strict=True):
        assert one([0.0, 0.0]) == pytest.approx([0.0], abs=1e-12) and one.jacobian([0.0, 0.0]) == pytest.approx(F, abs=1e-9)
        np.testing.assert_allclose(one(y), share * mixtures[0](y) + (1 - share) * F @ y, atol=1e-9)
    J = law.jacobian([0.0, 0.0])
    np.testing.assert_allclose(mixtures[0](y), law(y) - law([0.0, 0.0])[:, None] + (F - J) @ y, atol=1e-9)


def test_the_gain_is_that_of_the_lqr_in_any_coordinates_of_the_measurement():
    C = np.array([[2.0, 1.0], [0.5, -1.0]])
    K, _ = discounted_lqr(STEEP, SPEC)
    assert local_gain(Plant(STEEP.A, STEEP.B, C), SPEC, TEACHER) @ C == pytest.approx(K, rel=1e-9)


def test_without_the_state_the_gain_is_the_teachers_slope():
    plant = Plant(STEEP.A, STEEP.B, [[1.0, 2.0]])
    assert local_gain(plant, SPEC, lambda y: np.clip(-1.3 * y, -1, 1)) == pytest.approx(np.array([[-1.3]]))


@pytest.mark.parametrize("seed", range(3))
def test_a_compressed_law_that_does_not_settle_is_mended(monkeypatch, seed):
    fits_in_vain(monkeypatch)
    assert not rest(STEEP, SPEC, wild(seed).with_saturated_output(SPEC.inputs)).holds
    small = compress(STEEP, SPEC, TEACHER, start=wild(seed), rounds=1, points=200, samples=40, training_iterations=0)
    assert small.rest.holds and 0 <= small.given_way <= 1 and "had to give way" in small.sentence
    x = SPEC.initial.vertices
    for _ in range(400):
        x = STEEP.A @ x + STEEP.B @ small.inc(x)
    assert np.max(np.abs(x)) < 1e-3 and small.cost < np.inf


def test_training_that_loses_stability_is_not_what_is_returned(monkeypatch):
    def spoiled(plant, spec, inner, **options):
        return compression.Training(inner, wild(0), 0.0, 1.0, 0.0, 1, "spoiled", 0.0, ())

    monkeypatch.setattr("synthesis.compression.train", spoiled)
    small = compress(STEEP, SPEC, TEACHER, 2, rounds=1, points=300, samples=40, iterations=10, training_iterations=3)
    assert small.rest.holds and small.given_way is None and small.inner.q == 2
    assert small.cost <= small.fitted_cost * 1.0001


def test_where_no_gain_helps_it_is_said(monkeypatch):
    """Box too large: the clipped LQR loses the corners as well."""
    fits_in_vain(monkeypatch)
    far = Spec(SPEC.Q, SPEC.R, 0.9, Box([-6.0, -6.0], [6.0, 6.0]), SPEC.inputs)
    monkeypatch.setattr(compression, "_refuse_lost", lambda *_: None)
    monkeypatch.setattr(compression, "lessons", lambda *_, **__: None)
    small = compress(STEEP, far, TEACHER, start=wild(0), rounds=1, points=200, samples=40, training_iterations=0)
    assert not small.rest.holds and np.isnan(small.given_way) and "does not settle" in small.sentence


@pytest.mark.slow
@pytest.mark.parametrize("units", [1, 3])
def test_few_units_and_little_training_settle_the_masses(units):
    case = masses(3)
    teacher = INC.from_mpc(case.plant, case.spec.Q, case.spec.R, 4, case.spec.inputs, discount=case.spec.discount)
    small = compress(case.plant, case.spec, teacher, units, activation=ReLU(), points=300, iterations=2, rounds=1,
                     training_iterations=1, samples=40)
    assert small.rest.holds and small.inner.q == units and "motions settle in simulation" in small.sentence
