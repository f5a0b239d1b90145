"""The regional certificate: what holds is true, what is not true is refused with its reason."""

from dataclasses import replace
from fractions import Fraction

import draws
import numpy as np
import oracles
import posed
import pytest

from inc_casadi import INC, Box, Plant, Polytope, ReLU, Saturation, Tanh
from inc_casadi.claims.regional import Regional
from inc_casadi.errors import DimensionError, InvalidInputError, NotCertifiedError
from inc_casadi.pieces.cell_enclosure import CellEnclosure
from inc_casadi.pieces.enclosure import Enclosure
from inc_casadi.pieces.fixed import ONE, Fixed
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.walk import Budget
from inc_casadi.regional_certificate import certify_region

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
K = np.array([[-1.37488222, -2.64897412]])
UNIT = Box([-1.0], [1.0])


def claim(scale=1.0, inputs=UNIT, discount=0.98, R=0.05):
    half = 0.8 * scale * np.ones(2)
    return Regional(Box(-half, half), inputs, np.eye(2), [[R]], discount)


def saturated(**changes):
    return certify_region(PLANT, INC.saturated(K, 1.0), claim(**changes))


def biased():
    """A law with a rest point off the origin, W != 0 and a unit of each kind."""
    W = [[0.2, -0.1, 0.3], [0.0, 0.25, 0.1], [0.15, 0.0, -0.3]]
    U, V = [[0.5, 0.3], [-0.4, 0.8], [0.2, -0.6]], [[0.1, -0.05, 0.2]]
    return INC(W, U, V, 0.8 * K, [0.3, 0.5, -0.2], [0.1], (ReLU(), Saturation(), ReLU()))


def test_what_it_says_is_true_of_sampled_motions():
    certificate = saturated().require()
    points = certificate.claim.initial.sample(3000, np.random.default_rng(0))
    x, u = oracles.roll_out(PLANT, certificate.inc, points, 200)
    costs = oracles.discounted_cost(x, u, np.eye(2), np.array([[0.05]]), 0.98)
    assert abs(costs.mean() - certificate.expected) < 4 * costs.std() / np.sqrt(3000)
    value, at = certificate.worst
    assert costs.max() <= value and np.abs(x[:, :, -1]).max() < 1e-8
    x, u = oracles.roll_out(PLANT, certificate.inc, at[:, None], 200)
    assert oracles.discounted_cost(x, u, np.eye(2), np.array([[0.05]]), 0.98)[0] == pytest.approx(value, rel=1e-8)
    assert certificate.expected < certificate.bound < certificate.expected * (1 + 1e-8)
    assert certificate.margins() == pytest.approx({"well-posed": 1.0, "followed": 0.0, "inputs": 0.0}, abs=1e-12)
    for part in ("every input stays within", "converges to x* = [0. 0.]", "at most 1.364962 in expectation"):
        assert part in str(certificate)


def test_a_rest_point_off_the_origin_and_its_exact_cost():
    plant = Plant([[0.9, 0.3], [-0.1, 0.8]], [[0.2], [0.5]])
    task = Regional(Box([-1.0, -0.5], [0.7, 1.2]), Box([-5.0], [5.0]), np.diag([1.0, 2.0]), [[0.3]], 0.9)
    inc = INC(*(getattr(biased(), name) for name in "WUV"), 0.1 * K, biased().b, biased().d, biased().activation)
    certificate = certify_region(plant, inc, task).require()
    points = task.initial.sample(4000, np.random.default_rng(1))
    x, u = oracles.roll_out(plant, inc, points, 300)
    costs = oracles.discounted_cost(x, u, task.Q, task.R, 0.9)
    assert np.linalg.norm(x[:, 0, -1]) > 0.1
    assert abs(costs.mean() - certificate.expected) < 4 * costs.std() / np.sqrt(4000)
    assert certificate.worst[0] >= costs.max()
    assert "x* = [" + f"{x[0, 0, -1]:.6f}"[:6] in str(certificate)


def test_proof_in_fractions_of_a_small_implicit_law():
    inc = INC([[0.3]], 0.7 * K, [[1.0]], np.zeros((1, 2)), activation=Saturation())
    certificate = certify_region(PLANT, inc, claim())
    proof = certificate.prove()
    assert proof.succeeded and not proof.reason


@pytest.mark.parametrize("budget, reason", [
    (Budget(pieces=4), "more than 4 pieces"),
    (Budget(steps=1), "still under way after 1 steps"),
    (Budget(seconds=0.0), "time limit of 0 s"),
])
def test_a_spent_budget_is_a_reason_and_never_a_certificate(budget, reason):
    certificate = certify_region(PLANT, INC.saturated(K, 1.0), claim(), budget)
    assert not certificate.holds() and reason in certificate.reason
    assert certificate.bound == np.inf and np.isnan(certificate.expected) and np.isnan(certificate.worst[0])
    assert not certificate.walk.complete and certificate.margins()["followed"] < 0
    proof = certificate.prove()
    assert not proof.succeeded and reason in proof.reason
    assert str(certificate).startswith("Not certified")
    with pytest.raises(NotCertifiedError, match="walk ended"):
        certificate.require()


def test_a_set_from_which_some_motions_grow_is_never_certified():
    certificate = certify_region(PLANT, INC.saturated(K, 1.0), claim(scale=3.0), Budget(pieces=5000))
    points = certificate.claim.initial.sample(500, np.random.default_rng(0))
    x, _ = oracles.roll_out(PLANT, certificate.inc, points, 100)
    lost = np.mean(np.abs(x[:, :, -1]).max(axis=0) > 1)
    assert lost > 0.03
    assert not certificate.holds() and certificate.bound == np.inf and not certificate.prove().succeeded
    assert certificate.margins()["followed"] < -0.5 * lost


def test_a_linear_law_beyond_its_limits_is_told_by_how_much():
    certificate = certify_region(PLANT, INC.linear(K), claim())
    # The first input from the corner (0.8, 0.8) is the largest.
    assert f"an input exceeds its limit by {0.8 * np.abs(K).sum() - 1:.3g}" == certificate.reason
    assert certificate.margins()["inputs"] == pytest.approx(1 - 0.8 * np.abs(K).sum(), rel=1e-12)
    assert not certificate.prove().succeeded and "exceeds its limit" in certificate.prove().reason
    assert certify_region(PLANT, INC.linear(K), claim(inputs=None)).holds()


def test_limits_are_kept_at_the_edge_and_not_beyond():
    reach = 0.8 * np.abs(0.2 * K).sum()
    plant = Plant([[0.9, 0.2], [0.0, 0.8]], [[0.2], [0.5]])
    for factor, holds in ((1.0 + 1e-9, True), (1.0 - 1e-9, False)):
        limits = Polytope([[1.0], [-2.0]], [factor * reach, 2 * factor * reach])
        certificate = certify_region(plant, INC.linear(0.2 * K), claim(inputs=limits))
        assert certificate.holds() == holds and certificate.prove().succeeded == holds


def test_corrupted_certificates_are_refused_or_true():
    good = certify_region(PLANT, INC.saturated(K, 1.0), claim()).require()
    for change, reason in (
        ({"P": -good.P}, "not invariant"),
        ({"P": np.diag([1.0, 1e-6])}, "not invariant"),
        ({"level": 1.01 * good.level}, "crosses"),
        ({"P": good.P / 2}, "crosses"),
        ({"P": None}, "no terminal set"),
        ({"claim": claim(inputs=Box([-0.9], [0.9]))}, ""),
        ({"claim": claim(scale=3.0), "budget": Budget(pieces=5000)}, "walk ended"),
        ({"budget": Budget(steps=0)}, "walk ended"),
        ({"inc": INC.saturated(-K, 1.0)}, ""),
        ({"inc": INC.saturated(K, 1.1)}, ""),
        ({"plant": Plant(1.5 * PLANT.A, PLANT.B)}, ""),
    ):
        bad = replace(good, **change)
        assert not bad.holds() and reason in bad.reason, change
        proof = bad.prove()
        assert not proof.succeeded and proof.reason, change
        assert bad.sentence.startswith("Not certified")


@pytest.mark.parametrize("change", [{"discount": 0.5}, {"R": 2.0}, {"scale": 0.5}, {"discount": 1.0}, {"inputs": None}])
def test_a_changed_claim_is_recomputed_and_true(change):
    good = saturated()
    changed = replace(good, claim=claim(**change)).require()
    task = changed.claim
    points = task.initial.sample(3000, np.random.default_rng(5))
    x, u = oracles.roll_out(PLANT, good.inc, points, 200)
    costs = oracles.discounted_cost(x, u, task.Q, task.R, task.discount)
    assert abs(costs.mean() - changed.expected) < 4 * costs.std() / np.sqrt(3000)


def test_a_smaller_ellipsoid_of_another_shape_gives_the_same_cost():
    good = saturated()
    other = replace(good, P=good.P + 0.05 * np.eye(2) * np.abs(good.P).max(), level=0.3 * good.level)
    assert other.holds(), other.reason
    assert other.expected == pytest.approx(good.expected, rel=1e-12)
    assert other.worst[0] == pytest.approx(good.worst[0], rel=1e-12)


def test_bad_numbers_are_refused_at_the_door():
    good = saturated()
    for change, error in (({"level": -1.0}, InvalidInputError), ({"P": np.full((2, 2), np.nan)}, InvalidInputError),
                          ({"P": np.eye(3)}, DimensionError), ({"P": np.triu(np.ones((2, 2)))}, InvalidInputError),
                          ({"claim": "regional"}, InvalidInputError), ({"inc": INC.linear([[1.0]])}, DimensionError)):
        with pytest.raises(error):
            replace(good, **change)


@pytest.mark.parametrize("plant, inc, reason", [
    (PLANT, INC([[0.2]], 0.8 * K, [[1.0]], np.zeros((1, 2)), activation=Tanh()), "activation Tanh.*not piecewise affine"),
    (Plant(PLANT.A, PLANT.B, dt=0.0), INC.saturated(K, 1.0), "sample the plant first"),
    (PLANT, INC([[1.2]], K, [[1.0]], np.zeros((1, 2)), activation=Saturation()), "not proved well posed"),
    (PLANT, INC.saturated(0 * K, 1.0), "does not stabilize: its spectral radius is 1.1"),
    (PLANT, INC([[0.0]], K, [[1.0]], np.zeros((1, 2))), "on or beyond a kink of hidden unit 0"),
])
def test_where_it_does_not_apply_it_says_why_and_every_question_has_an_answer(plant, inc, reason):
    certificate = certify_region(plant, inc, claim())
    assert not certificate.holds()
    with pytest.raises(NotCertifiedError, match=reason):
        certificate.require()
    assert certificate.bound == np.inf and np.isnan(certificate.worst[0])
    assert not certificate.prove().succeeded and certificate.margins()["followed"] == -1.0
    given = replace(certificate, P=np.eye(2), level=1e-6)
    assert not given.holds() and given.bound == np.inf and not given.prove().succeeded


def test_an_idle_smooth_unit_does_not_stand_in_the_way():
    inc = INC(np.diag([0.1, 0.0]), np.vstack([K, K]), [[0.0, 1.0]], np.zeros((1, 2)), activation=(Tanh(), Saturation()))
    certificate = certify_region(PLANT, inc, claim()).require()
    assert certificate.expected == pytest.approx(1.36496190, abs=1e-8)


def test_a_law_from_python_control_is_accepted():
    control = pytest.importorskip("control")
    plant = control.StateSpace(PLANT.A, PLANT.B, np.eye(2), np.zeros((2, 1)), 1.0)
    assert certify_region(plant, INC.saturated(K, 1.0), claim()).holds()


def test_no_cost_at_all_is_proved_to_be_zero():
    task = Regional(Box([-0.8, -0.8], [0.8, 0.8]), UNIT, np.zeros((2, 2)), [[0.0]], 0.9)
    certificate = certify_region(PLANT, INC.saturated(K, 1.0), task).require()
    assert certificate.bound == 0.0 and certificate.prove().succeeded


def test_a_bound_below_the_exact_cost_is_not_proved(monkeypatch):
    certificate = saturated()
    monkeypatch.setattr("inc_casadi.regional_certificate.ROUNDING", -1e-8)
    assert certificate.prove().reason.startswith("the expected cost exceeds the bound")


def test_small_and_large_units_give_the_same_proof():
    for size in (1e-4, 1e4):
        half = 0.8 * size * np.ones(2)
        task = Regional(Box(-half, half), Box([-size], [size]), np.eye(2), [[0.05]], 0.98)
        certificate = certify_region(PLANT, INC.saturated(K, size), task).require()
        assert certificate.expected == pytest.approx(1.36496190 * size**2, rel=1e-8)
        assert certificate.prove().succeeded


def test_every_part_of_a_rigorous_proof_can_refuse(monkeypatch):
    import inc_casadi.regional_proof as module
    assert saturated().prove().method == module.PLACES_OF_POLYTOPES
    with monkeypatch.context() as patch:
        patch.setattr("inc_casadi.well_posed.exact.contracts", lambda *_: False)
        assert "well posed" in saturated().prove().reason
    with monkeypatch.context() as patch:
        patch.setattr(module, "MOST_VERTICES", 1)
        assert saturated().prove().method == module.PLACES_OF_SIMPLICES
    with monkeypatch.context() as patch:
        patch.setattr("inc_casadi.pieces.cell_proof.trouble", lambda *_: "a vertex is missing")
        assert saturated().prove().method == module.PLACES_OF_SIMPLICES
    with monkeypatch.context() as patch:
        patch.setattr(CellEnclosure, "arrives", lambda *_: False)
        assert saturated().prove().method == module.PLACES_OF_SIMPLICES
        patch.setattr(Enclosure, "arrives", lambda *_: False)
        assert saturated().prove().method == module.FRACTIONS
        patch.setattr(module, "EXACT_PIECES", 0)
        assert "rounding errors grow too large" in saturated().prove().reason
    with monkeypatch.context() as patch:
        patch.setattr(module, "EXACT_PIECES", 0)
        large = Enclosure(np.zeros((9, 2)), np.zeros((9, 1)), 1e-6, 0.0)
        patch.setattr(module, "enclose", lambda *_: large)
        patch.setattr("inc_casadi.pieces.cell_proof.enclose_cells", lambda *_: (large, (), True))
        assert "expected cost exceeds the bound" in saturated().prove().reason
    certificate = saturated()
    stated = module.Stated(certificate.claim, certificate._exact[1], certificate.bound, certificate.worst_bound, True)
    assert "worst cost exceeds" in stated.excess(Fraction(0), Fraction(certificate.worst_bound) + 1)
    assert stated.excess(Fraction(certificate.bound), Fraction(certificate.worst_bound)) == ""
    assert "expected cost exceeds" in stated.excess(None, Fraction(0))


def test_a_kink_tolerance_that_is_too_coarse_proves_nothing(monkeypatch):
    import inc_casadi.regional_proof as module
    monkeypatch.setattr(module, "EXACT_PIECES", 0)
    monkeypatch.setattr(module, "MOST_VERTICES", 0)
    bent = INC([[0.3]], [[1.0, 2.0]], [[0.1]], K, [0.4], [-0.04 / 0.7], ReLU()).with_saturated_output(UNIT)
    certificate = certify_region(PLANT, bent, claim())
    assert certificate.holds() and certificate.prove()
    coarse = replace(certificate)
    assert coarse.holds()  # the walk in floats is done with the fine tolerance
    monkeypatch.setattr(PiecewiseLoop, "kink_tolerance", Fixed(ONE // 100))
    assert "rounding errors grow too large" in coarse.prove().reason


def mpc_claim():
    return Regional(Box([-0.8, -0.8], [0.8, 0.8]), UNIT, np.eye(2), [[0.05]], 0.98)


def test_a_model_predictive_law_is_proved_though_perron_frobenius_rejects_it():
    """eta = sat((I - step H) eta - step F x) with lambda_pf(|I - step H|) = 1.35: the law of a program over four inputs."""
    law = posed.mpc_law()
    assert law.well_posedness().radius > 1.3
    certificate = certify_region(posed.PLANT, law, mpc_claim()).require()
    proof = certificate.prove()
    assert proof.succeeded and proof.method.startswith("256 binary places")
    assert 0 < certificate.margins()["well-posed"] == law.well_posedness().monotonicity
    points = certificate.claim.initial.sample(2000, np.random.default_rng(0))
    costs, x = np.zeros(2000), points
    for k in range(200):
        u = law(x)
        costs += 0.98**k * (np.sum(x * x, axis=0) + 0.05 * np.sum(u * u, axis=0))
        x = posed.PLANT.A @ x + posed.PLANT.B @ u
    assert np.abs(x).max() < 1e-6 and costs.max() <= certificate.worst_bound
    assert abs(costs.mean() - certificate.expected) < 4 * costs.std() / np.sqrt(2000)
    # A program of longer view costs no more than the clipped optimal gain, up to what is lost by the horizon.
    assert certificate.expected == pytest.approx(1.36497831, abs=1e-7)


def test_its_proof_in_fractions_agrees(monkeypatch):
    certificate = certify_region(posed.PLANT, posed.mpc_law(horizon=3), mpc_claim()).require()
    for kind in (Enclosure, CellEnclosure):
        monkeypatch.setattr(kind, "arrives", lambda *_: False)
    proof = certificate.prove()
    assert proof.succeeded and proof.method == "exact fractions over all pieces"


def test_a_multiplier_that_is_not_one_proves_nothing():
    law = posed.mpc_law()
    certificate = certify_region(posed.PLANT, law, mpc_claim()).require()
    for change in ({"T": np.array([1.0, 50.0, 1.0, 1.0])}, {"T": -np.ones(4)},
                   {"monotonicity": 2.0 * law.well_posedness().monotonicity}):
        law.__dict__["_well_posedness"] = replace(certificate._law.well_posedness(), **change)
        again = replace(certificate, inc=law)
        assert again.holds() and "not proved well posed" in again.prove().reason, change


def test_the_law_without_idle_units_must_be_proved_too(monkeypatch):
    import inc_casadi.regional_certificate as module
    certificate = certify_region(posed.PLANT, posed.mpc_law(), mpc_claim()).require()
    verdicts = iter([True, False])
    monkeypatch.setattr(module, "is_proved", lambda *_: next(verdicts))
    assert "not proved well posed" in certificate.prove().reason


def by_polytopes(monkeypatch, certificate, built_in=True, **changes):
    """What the first proof says when following the polytopes came to a changed result, and the terminal set it was given."""
    import inc_casadi.regional_proof as module
    seen = []

    def settle(walk, loop, claim, terminal, deadline, begin=None):
        seen.append(terminal)
        return replace(original(walk, loop, claim, terminal, deadline), **changes)

    original = module.settle
    stated = module.Stated(certificate.claim, certificate._exact[1], certificate.bound, certificate.worst_bound, built_in)
    with monkeypatch.context() as patch:
        patch.setattr(module, "settle", settle)
        loop = PiecewiseLoop(PLANT, certificate.inc, "fixed")
        return module._by_polytopes(loop, stated, certificate.walk), seen[0]


def test_whatever_following_the_polytopes_leaves_open_is_refused(monkeypatch):
    certificate = saturated()
    said, terminal = by_polytopes(monkeypatch, certificate)
    exactly = certificate._exact[1].level
    assert said == "" and terminal.level.fraction() == pytest.approx(exactly * (1 - Fraction(1, 2**40)), abs=1e-70)
    assert terminal.level.fraction() < exactly * (1 - Fraction(1, 2**41))
    assert "does not arrive" in by_polytopes(monkeypatch, certificate, arrived=False)[0]
    assert "expected cost exceeds" in by_polytopes(monkeypatch, certificate, expected=None)[0]
    states, inputs = np.zeros((4, 2)), np.zeros((3, 1))
    expected, worst = Fraction(certificate.bound), Fraction(certificate.worst_bound)
    for cost, change, what in ((0.0, {"expected": expected, "worst": worst}, ""),
                               (1e-12, {"expected": expected, "worst": Fraction(0)}, "expected cost exceeds"),
                               (1e-12, {"expected": Fraction(0), "worst": worst}, "worst cost exceeds"),
                               (np.inf, {}, "errors grow too large")):
        said, _ = by_polytopes(monkeypatch, certificate, enclosure=Enclosure(states, inputs, cost, 0.0), **change)
        assert what in said and bool(said) == bool(what)


def test_an_input_at_its_limit_is_only_accepted_where_the_limit_is_built_in(monkeypatch):
    certificate = saturated()
    assert by_polytopes(monkeypatch, certificate, built_in=True)[0] == ""
    assert "too close to a limit" in by_polytopes(monkeypatch, certificate, built_in=False)[0]


def test_following_polytopes_is_given_up_when_the_time_is_over(monkeypatch):
    import inc_casadi.regional_proof as module
    certificate = saturated()
    stated = module.Stated(certificate.claim, certificate._exact[1], certificate.bound, certificate.worst_bound, True)
    loop = PiecewiseLoop(PLANT, certificate.inc, "fixed")
    assert module._by_polytopes(loop, stated, certificate.walk, 1e-9) == "the time limit of 1e-09 s"
    assert module._by_polytopes(loop, stated, certificate.walk) == ""


def test_room_at_the_limits_is_asked_for_only_where_they_are_not_built_in(monkeypatch):
    import inc_casadi.regional_proof as module
    certificate = saturated()
    stated = module.Stated(certificate.claim, certificate._exact[1], certificate.bound, certificate.worst_bound, True)
    for built_in, said in ((True, ""), (False, "an input comes too close to a limit that is not built into the controller")):
        loop = PiecewiseLoop(PLANT, certificate.inc, "fixed")
        assert module._by_polytopes(loop, replace(stated, built_in=built_in), certificate.walk) == said


def test_pieces_that_meet_only_up_to_rounding_prove_nothing():
    from dataclasses import dataclass

    from inc_casadi.activations.base import Pieces

    @dataclass(frozen=True)
    class Bent(Saturation):
        @property
        def pieces(self):
            return Pieces(np.array([-1.0, 0.7]), np.array([0.0, 1.0, 0.3]), np.array([-1.0, 0.0, 0.7 - 0.3 * 0.7]))

        def formula(self, z, ops):
            return ops.fmax(-1.0, z) - 0.7 * ops.fmax(0.0, z - 0.7)

    inc = INC(np.zeros((1, 1)), K, [[1.0]], np.zeros((1, 2)), activation=Bent())
    certificate = certify_region(PLANT, inc, Regional(Box([-0.1, -0.1], [0.1, 0.1]), None, np.eye(2), [[0.05]], 0.98))
    assert certificate.holds() and "do not meet exactly" in certificate.prove().reason


def test_in_many_dimensions_the_largest_cost_bounds_the_expected_one():
    n = 9
    start = Polytope.from_vertices(np.arange(1.0, n + 1)[:, None] + 0.1 * draws.regular_simplex(n))
    plant = Plant(np.diag(np.linspace(0.1, 0.9, n)), np.ones((n, 1)))
    law = INC.saturated(-0.01 * np.ones((1, n)), 0.2)
    certificate = certify_region(plant, law, Regional(start, Box(-1, 1), np.eye(n), 0.1, 0.95))
    assert np.isnan(certificate.expected) and certificate.bound == certificate.worst_bound and certificate.prove()
    x, weight, total = start.vertices, 1.0, 0.0
    for _ in range(400):
        u = law(x)
        total = total + weight * (np.sum(x * x, axis=0) + 0.1 * u[0] ** 2)
        x, weight = plant.A @ x + plant.B @ u, 0.95 * weight
    assert np.max(total) <= certificate.bound <= np.max(total) * (1 + 1e-6)
    assert "in expectation" not in certificate.sentence


def test_a_proof_that_runs_out_of_time_says_so_and_proves_nothing():
    found = saturated()
    assert found.prove(seconds=60.0)
    late = found.prove(seconds=0.0)
    assert not late and "time limit" in late.reason


def test_a_proof_does_not_depend_on_the_units_of_the_states():
    """States in units of 1e-4: what makes the tail strict must be small beside the tail itself in every direction."""
    T = np.diag([1.0, 1e-4])
    plant = Plant(np.linalg.solve(T, PLANT.A @ T), np.linalg.solve(T, PLANT.B))
    wide = Regional(Box([-0.8, -8000.0], [0.8, 8000.0]), UNIT, T @ np.eye(2) @ T, [[0.05]], 0.98)
    found = certify_region(plant, INC.saturated(K @ T, 1.0), wide)
    proof = found.prove()
    assert proof and "every polytope" in proof.method and found.bound == pytest.approx(saturated().bound, rel=1e-8)
