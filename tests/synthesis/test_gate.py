"""The gate lets through what is proved and names what is in the way of the rest."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Ellipsoid, Gaussian, Plant, Polytope, ReLU, Spec, Tanh, Uniform
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.claims import Regional
from inc_casadi.ellipsoidal_region import EllipsoidalRegion
from inc_casadi.regional_certificate import RegionalCertificate, certify_region
from synthesis import synthesize
from synthesis.gate import gate

SCALAR = Plant([[1.5]], [[1.0]])
LIMITED = Spec([[1.0]], [[0.0]], 0.9, Box([-1.0], [1.0]), Box([-1.0], [1.0]))


def test_a_saturated_law_on_an_unstable_plant_passes_by_pieces():
    verdict = gate(SCALAR, LIMITED, INC.saturated([[-1.5]], 1.0))
    assert verdict.accepted and isinstance(verdict.certificate, RegionalCertificate)
    assert verdict.cost == pytest.approx(1 / 3 + 0.9 / 36, rel=1e-8)
    assert any("input limits" in words for words in verdict.proofs)


def test_a_linear_law_that_exceeds_the_limit_is_refused_with_the_amount():
    verdict = gate(SCALAR, LIMITED, INC.linear([[-1.5]]))
    assert not verdict.accepted and verdict.cost == np.inf
    assert any("exceeds its limit by 0.5" in why for why in verdict.refusals)
    assert any("not built into" in why for why in verdict.refusals)


def test_too_large_a_set_is_refused_on_both_ways():
    wide = Spec([[1.0]], [[0.0]], 0.9, Box([-2.5], [2.5]), Box([-1.0], [1.0]))
    verdict = gate(SCALAR, wide, INC.saturated([[-1.5]], 1.0))
    assert not verdict.accepted
    assert any(why.startswith("exact pieces: the walk ended") for why in verdict.refusals)
    assert any("no bounded input stabilizes" in why for why in verdict.refusals)


def test_smooth_units_and_unbounded_distributions_go_to_the_inequality():
    plant = Plant([[0.8, 0.1], [0.0, 0.7]], [[0.0], [1.0]])
    law = INC([[0.2]], [[-0.3, -0.2]], [[0.5]], [[0.0, 0.0]], activation=Tanh())
    normal = Spec(np.eye(2), [[1.0]], 0.95, Gaussian([0.0, 0.0], np.eye(2)), Box([-1.0], [1.0]))
    verdict = gate(plant, normal, law)
    assert verdict.accepted and isinstance(verdict.certificate, MatrixCertificate)
    assert any("not uniform over a polytope" in why for why in verdict.refusals)
    uniform = Spec(np.eye(2), [[1.0]], 0.95, Uniform(Box([-1.0, -1.0], [1.0, 1.0])), Box([-1.0], [1.0]))
    assert any("not piecewise affine" in why for why in gate(plant, uniform, law).refusals)


def test_a_law_that_does_not_stabilize_is_refused_by_the_inequality():
    spec = Spec([[1.0]], [[1.0]], 0.95, Gaussian([0.0], [[1.0]]))
    verdict = gate(Plant([[0.9]], [[1.0]]), spec, INC([[0.1]], [[0.5]], [[1.0]], [[0.3]], activation=Tanh()))
    assert not verdict.accepted and verdict.cost == np.inf
    assert any("spectral radius 1.7" in why for why in verdict.refusals)


def test_an_ill_posed_candidate_is_refused_before_anything_is_evaluated():
    verdict = gate(SCALAR, LIMITED, INC([[1.5]], [[1.0]], [[1.0]], [[0.0]], activation=ReLU()))
    assert not verdict.accepted and "1.5" in verdict.refusals[0] and "well-posedness" in verdict.refusals[0]


def test_a_missing_solver_is_a_reason_and_not_a_traceback(monkeypatch):
    import sys
    plant, spec = Plant([[0.8]], [[1.0]]), Spec([[1.0]], [[1.0]], 0.9, Box([-1.0], [1.0]))
    law = INC([[0.2]], [[-0.3]], [[0.5]], [[0.0]], activation=Tanh())
    for name in ("cvxpy", "clarabel"):  # the interior-point method needs neither
        monkeypatch.setitem(sys.modules, name, None)
    assert gate(plant, spec, law).accepted
    for name in ("scipy", "scipy.linalg"):
        monkeypatch.setitem(sys.modules, name, None)
    verdict = gate(plant, spec, law)
    assert not verdict.accepted and any("pip install scipy" in why for why in verdict.refusals)


def test_polytopic_limits_are_checked_at_the_worst_corner():
    plant = Plant(np.diag([0.5, 0.4]), np.eye(2))
    law = INC.saturated([[-0.4, 0.0], [0.0, -0.3]], [1.0, 1.0])
    diamond = Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [1.0] * 4)
    spec = Spec(np.eye(2), np.eye(2), 0.9, Gaussian([0.0, 0.0], np.eye(2)), diamond)
    assert any("not built into" in why for why in gate(plant, spec, law).refusals)
    small = INC.saturated([[-0.4, 0.0], [0.0, -0.3]], [0.5, 0.5])
    assert gate(plant, spec, small).accepted


def test_a_box_of_many_dimensions_goes_to_the_inequality():
    plant = Plant(0.5 * np.eye(10), np.ones((10, 1)))
    spec = Spec(np.eye(10), [[1.0]], 0.9, Box(-np.ones(10), np.ones(10)))
    law = INC.linear(-0.01 * np.ones((1, 10)))
    verdict = gate(plant, spec, law)
    assert verdict.accepted and not isinstance(verdict.certificate, RegionalCertificate)
    exact = certify_region(plant, law, Regional(spec.initial, None, spec.Q, spec.R, 0.9))
    assert exact.holds() and np.isnan(exact.expected) and verdict.cost < 0.7 * exact.bound


def test_a_bias_free_relu_controller_passes_by_pieces_though_it_rests_on_its_kinks():
    plant = Plant([[1.05, 0.2], [0.0, 0.9]], [[0.0], [1.0]])
    law = INC([[0.2, -0.1], [0.1, 0.3]], [[1.0, 0.3], [-0.8, 0.5]], [[-0.2, 0.1]], [[-0.7, -0.9]])
    verdict = gate(plant, Spec(np.eye(2), [[0.1]], 0.95, Box([-1.0, -1.0], [1.0, 1.0])), law)
    assert verdict.accepted and isinstance(verdict.certificate, RegionalCertificate)
    assert verdict.certificate.conewise is not None and verdict.certificate.prove()
    assert any("converges from every initial state" in words for words in verdict.proofs)


@pytest.mark.slow
def test_a_tanh_law_of_synthesize_on_an_unstable_plant_is_certified_by_an_ellipsoid():
    plant = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
    spec = Spec(np.eye(2), 0.05, 0.98, Ellipsoid(np.eye(2) / 0.16), Box(-1, 1))
    result = synthesize(plant, spec, hidden=4, activation=Tanh(), starts=("random",), seconds=30, verbose=False)
    assert result.status == "certified" and isinstance(result.certificate, EllipsoidalRegion)
    assert any(isinstance(unit, Tanh) for unit in result.inc.activations) and result.proof
    assert result.estimate.mean < result.cost < 1.2 * result.estimate.mean
    assert result.chosen.verdict.accepted and not result.chosen.verdict.settled


def test_a_loop_that_grows_slower_than_the_discount_fades_is_refused():
    """x+ = 1.019 x has a finite discounted cost; no controller whose motions grow without end is to be signed for."""
    verdict = gate(Plant(1.02, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1)), INC.linear([[-0.001]]))
    assert not verdict.accepted and any("come to rest" in reason for reason in verdict.refusals)
    calm = gate(Plant(1.02, 1.0), Spec(1.0, 0.0, 0.9, Gaussian([0.0], [[1.0]])), INC.linear([[-0.5]]))
    assert calm.accepted and any(words.startswith("converges") for words in calm.proofs)
