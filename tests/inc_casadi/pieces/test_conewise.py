"""Equilibria on kinks: the law in deviations, the room of its bounds, and the certificates that rest on them."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, Gaussian, LeakyReLU, Plant, ReLU, Saturation, certify, load
from inc_casadi.__main__ import main
from inc_casadi.activations import TwoSlopes
from inc_casadi.blocks import exact
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.claims import DiscountedCost, Stability
from inc_casadi.claims.regional import Regional
from inc_casadi.errors import InvalidInputError
from inc_casadi.pieces.conewise import NO_KINK, ConewiseLaw, conewise_law, largest_level, rooms
from inc_casadi.pieces.conewise_tail import ConewiseProof, is_semidefinite
from inc_casadi.regional_certificate import certify_region

PLANE = Plant([[0.9, 0.4], [-0.3, 1.0]], [[0.2, 0.1], [0.5, -0.3]], [[1.0, 0.2], [0.0, 1.0], [0.5, -0.4]])
SCALAR = Plant([[0.5]], [[1.0]])
# x* = 2, z* = 0 and u* = 1, all dyadic: phi(0.25 eta + x - 2) with eta = 0.
BIASED = INC([[0.25]], [[1.0]], [[-0.25]], [[0.0]], [-2.0], [1.0])


def bias_free(n, m, q, seed, push=0.3):
    """A plant just unstable under an LQR gain, and implicit ReLU units that bend it."""
    from scipy.linalg import solve_discrete_are
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, m))
    A *= 1.05 / np.max(np.abs(np.linalg.eigvals(A)))
    P = solve_discrete_are(A, B, np.eye(n), np.eye(m))
    K = -np.linalg.solve(np.eye(m) + B.T @ P @ B, B.T @ P @ A)
    W = rng.uniform(-1, 1, (q, q)) * 0.5 / q
    V = push * np.abs(K).max() / np.sqrt(q) * rng.standard_normal((m, q))
    return Plant(A, B), INC(W, rng.standard_normal((q, n)), V, K)


def task(n, m, discount, inputs=None, half=1.0):
    return Regional(Box(-half * np.ones(n), half * np.ones(n)), inputs, np.eye(n), 0.1 * np.eye(m), discount)


def mixed():
    """A law whose units rest on kinks of several kinds at x* = 0, some not on a kink, one flat there."""
    units = (ReLU(), Saturation(), Saturation(), LeakyReLU(0.25), ReLU(), ReLU())
    b = [0.0, 1.0, 0.5, 0.0, -0.5, 0.75]
    W = np.zeros((6, 6))
    W[0, 3], W[3, 0], W[1, 0], W[2, 4] = 0.25, -0.125, 0.5, 0.5
    rng = np.random.default_rng(4)
    V = rng.integers(-4, 5, (2, 6)) / 64.0
    eta = np.array([0.0, 1.0, 0.5, 0.0, 0.0, 0.75])
    return INC(W, rng.integers(-8, 9, (6, 3)) / 8.0, V, np.zeros((2, 3)), b, -V @ eta, units)


def costs_at_vertices(certificate, steps=500):
    """The certified and the simulated cost from every vertex of every cell."""
    arrived, claim = certificate.walk.arrived, certificate.claim
    lifted = arrived.lifted()
    stated = ((lifted[:, None, :] @ arrived.cost[arrived.owner])[:, 0] * lifted).sum(axis=1)
    x, u = oracles.roll_out(certificate.plant, certificate.inc, arrived.start.T, steps)
    return stated, oracles.discounted_cost(x, u, claim.Q, claim.R, claim.discount)


def check(certificate, steps=500):
    """What a certificate says of every starting point is true, within its gap."""
    stated, true = costs_at_vertices(certificate, steps)
    rounding = 1e-10 * certificate.worst[0]
    assert np.all(true <= stated + rounding) and np.all(stated <= true + certificate.gap + rounding)
    assert certificate.worst[0] == pytest.approx(stated.max(), rel=1e-12)
    points = certificate.claim.initial.sample(2000, np.random.default_rng(0))
    x, u = oracles.roll_out(certificate.plant, certificate.inc, points, steps)
    found = oracles.discounted_cost(x, u, certificate.claim.Q, certificate.claim.R, certificate.claim.discount)
    assert found.max() <= certificate.worst[0] + rounding
    assert abs(found.mean() - certificate.expected) < certificate.gap + 4 * found.std() / np.sqrt(2000)


def test_the_papers_implicit_example_is_certified_to_its_true_cost():
    # eq:implicit_example_controller; the paper certifies 1.3006, the true cost of x0 = 1 is 1.07442.
    inc = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
    claim = Regional(Box([-1.0], [1.0]), None, [[1.0]], [[0.05]], 0.98)
    certificate = certify(Plant([[1.2]], [[1.0]]), inc, claim)
    assert certificate.holds() and certificate.conewise is not None
    assert certificate.worst[0] == pytest.approx(1.07442, abs=5e-6)
    assert certificate.expected == pytest.approx(certificate.worst[0] / 3, rel=1e-8)  # both sides cost the same
    assert 0 < certificate.gap <= 1e-9 * certificate.worst[0]
    check(certificate)
    proof = certificate.prove()
    assert proof and "after matrix certificates of the conewise linear loop" in proof.method


@pytest.mark.parametrize("n, m, q, seed, discount", [
    (1, 2, 3, 0, 1.0), (2, 1, 4, 1, 0.95), (2, 2, 6, 2, 1.0), pytest.param(3, 1, 3, 0, 0.9, marks=pytest.mark.slow),
])
def test_bias_free_implicit_relu_laws_are_certified_and_proved(n, m, q, seed, discount):
    plant, inc = bias_free(n, m, q, seed)
    assert np.any(inc.W) and np.max(np.abs(np.linalg.eigvals(plant.A))) > 1
    certificate = certify_region(plant, inc, task(n, m, discount)).require()
    assert certificate.gap <= 1e-8 * certificate.worst[0]
    check(certificate)
    assert certificate.prove()


def test_cones_that_turn_into_each_other_without_end():
    turn = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]])
    rng = np.random.default_rng(0)
    W, U, V = 0.2 * rng.uniform(-1, 1, (3, 3)), rng.standard_normal((3, 2)), 0.05 * rng.standard_normal((2, 3))
    inc = INC(W, U, V, np.zeros((2, 2)))
    certificate = certify_region(Plant(0.9 * turn, np.eye(2)), inc, task(2, 2, 0.95)).require()
    assert len(certificate.walk.trails.patterns) == 6 and len(certificate.walk.arrived) > 300  # a few cones, in many orders
    assert certificate.gap <= 1e-6 * certificate.worst[0]
    check(certificate)
    assert certificate.prove()


@pytest.mark.parametrize("built_in", [True, False])
def test_a_relu_law_with_input_limits(built_in):
    plant, inc = bias_free(2, 1, 4, 5)
    reach = float(np.abs(inc(plant.C @ np.array([[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, 1.0, -1.0]]))).max())
    limits = Box([-0.7 * reach], [0.7 * reach]) if built_in else Box([-3 * reach], [3 * reach])
    law = inc.with_saturated_output(limits) if built_in else inc
    certificate = certify_region(plant, law, task(2, 1, 0.95, limits)).require()
    check(certificate)
    assert certificate.prove()
    if not built_in:
        tight = Regional(certificate.claim.initial, Box([-0.7 * reach], [0.7 * reach]), np.eye(2), [[0.1]], 0.95)
        assert "exceeds its limit" in certify_region(plant, inc, tight).reason


@pytest.mark.parametrize("discount", [0.5, 0.95])
def test_a_biased_loop_that_rests_on_a_kink_and_pays_for_resting(discount):
    claim = Regional(Box([-1.0], [4.0]), Box([-1.0], [1.5]), [[1.0]], [[0.1]], discount)
    certificate = certify_region(SCALAR, BIASED, claim).require()
    assert certificate._setting[1].x.tolist() == [2.0] and certificate.gap <= 1e-8 * certificate.worst[0]
    check(certificate, 800)
    assert certificate.prove()
    coarse = replace(certificate, level=1e8 * certificate.level)
    assert coarse.holds() and coarse.gap > 1e3 * certificate.gap and coarse.expected > certificate.expected
    check(coarse, 800)


def test_a_saturation_that_rests_at_its_own_end_where_the_input_limit_is():
    law = INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], [3.0], activation=Saturation())  # x* = 2, z* = 1 = u*
    claim = Regional(Box([-1.0], [4.0]), Box([-1.0], [1.0]), [[1.0]], [[0.1]], 0.9)
    certificate = certify_region(SCALAR, law, claim).require()
    assert certificate.conewise.settling.inc.activations == (TwoSlopes(1.0, 0.0),)
    check(certificate)
    assert certificate.prove()


@pytest.mark.parametrize("right, rung", [(-1.9, "relu"), (-4.0, "lifted")])
def test_half_lines_that_need_gains_of_their_own(right, rung):
    # -0.4 on the right and 0.8 on the left; -2.5 and 0.1: what grows on one side shrinks on the other.
    left = 0.7 if rung == "relu" else 1.4
    law = INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[right, left]], [[0.0]])
    claim = Regional(Box([-1.0], [2.0]), None, [[1.0]], [[0.1]])
    certificate = certify_region(Plant([[1.5]], [[1.0]]), law, claim).require()
    assert certificate.conewise.settling.multiplier.name == rung
    check(certificate)
    assert certificate.prove()


def test_a_law_with_a_well_posed_w_that_does_not_contract():
    law = INC([[-3.0, 0.5], [0.0, -2.0]], [[1.0], [-1.0]], [[-0.8, 0.5]], [[0.0]])
    assert not law.contraction.contracts
    claim = Regional(Box([-1.0], [2.0]), Box([-1.0], [1.0]), [[1.0]], [[0.1]], 0.95)
    certificate = certify_region(Plant([[0.95]], [[1.0]]), law, claim).require()
    assert certificate.prove()
    x = np.linspace(-1, 2, 4001)[None]
    total, weight = np.zeros(4001), 1.0
    for _ in range(400):
        u = law(x)
        total, x, weight = total + weight * (x[0] ** 2 + 0.1 * u[0] ** 2), 0.95 * x + u, 0.95 * weight
    assert total.max() == pytest.approx(certificate.worst[0], rel=1e-8)
    assert total.mean() == pytest.approx(certificate.expected, rel=1e-3)


def test_the_law_in_deviations_is_the_law_itself_within_its_room():
    inc = mixed()
    local = conewise_law(PLANE, inc)
    assert isinstance(local, ConewiseLaw) and not local.x.any() and not local.u.any()
    assert local.on_kinks == (0, 1, 3) and local.kept.tolist() == [0, 1, 2, 3, 5]
    assert local.inc.activations == (TwoSlopes(0.0, 1.0), TwoSlopes(1.0, 0.0), TwoSlopes(1.0, 1.0), TwoSlopes(0.25, 1.0),
                                     TwoSlopes(1.0, 1.0))
    M, limits = np.array([[2.0, 0.3], [0.3, 0.5]]), Box([-0.2, -0.1], [0.3, 0.4])
    found = rooms(PLANE, inc, local, limits, M)
    assert {room.name for room in found} == {f"a kink of hidden unit {i}" for i in (1, 2, 4, 5)} | {
        f"input limit {i}" for i in range(4)}
    level = largest_level(found)
    e = np.random.default_rng(0).standard_normal((2, 5000))
    e *= np.sqrt(level / oracles.quadratic(M, e))
    np.testing.assert_allclose(inc(PLANE.C @ e), local.inc(PLANE.C @ e), atol=1e-12)
    assert np.all(limits.contains(inc(PLANE.C @ e)))
    far = 40 * e
    assert np.max(np.abs(inc(PLANE.C @ far) - local.inc(PLANE.C @ far))) > 1e-3
    # Each reach bounds what it is about, and by not much more than the triangle inequality costs.
    z = inc.W[:, local.kept] @ local.inc.hidden(PLANE.C @ e) + inc.U @ PLANE.C @ e
    H, u = limits.H, local.inc(PLANE.C @ e)
    for room in found:
        kind, i = room.name.rsplit(" ", 1)
        moved = np.abs(z[int(i)]) if "unit" in kind else np.abs(H[int(i)] @ u)
        assert moved.max() <= np.sqrt(level) * room.reach < 8 * moved.max()
        assert room.holds(Fraction(level)) and not room.holds(2 * Fraction(float(room.distance) / room.reach) ** 2)


def test_motions_settle_within_the_ellipsoids_that_are_claimed():
    plant, inc = bias_free(2, 1, 4, 1)
    certificate = certify_region(plant, inc, task(2, 1, 0.95)).require()
    proof, level = certificate.conewise, certificate.level
    e = np.random.default_rng(0).standard_normal((2, 500))
    e *= np.sqrt(level / oracles.quadratic(proof.P, e))
    x, _ = oracles.roll_out(plant, inc, e, 300)
    assert oracles.quadratic(proof.M, x).max() <= level and oracles.quadratic(proof.M, x[:, :, -1]).max() < 1e-12 * level


@pytest.mark.parametrize("inc, discount, inputs, reason", [
    (INC([[0.25]], [[1.0]], [[-0.25]], [[0.0]], [-2.0 + 1e-14], [1.0]), 0.9, None, "e-15 from a kink, but not on it"),
    (BIASED, 1.0, None, "costs something at every step, and discount = 1"),
    (BIASED, 0.9, Box([-1.0], [1.0]), "inputs so close to a limit"),
    (INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[-2.5, 0.2]], [[0.0]]), 0.9, None, ""),  # -2 on the right, 0.3 on the left
    (INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[-2.5, 2.0]], [[0.0]]), 0.9, None, "no certificate of stability was found"),
])
def test_reasons_for_having_none(inc, discount, inputs, reason):
    certificate = certify_region(SCALAR, inc, Regional(Box([-1.0], [4.0]), inputs, [[1.0]], [[0.1]], discount))
    assert reason in certificate.reason and bool(reason) != certificate.holds()
    if reason:
        assert certificate.bound == np.inf and certificate.gap == np.inf and not certificate.prove()
        assert str(certificate).startswith("Not certified")


def test_a_missing_solver_is_a_reason(monkeypatch):
    import sys
    for name in ("scipy", "scipy.linalg"):
        monkeypatch.setitem(sys.modules, name, None)
    law = INC([[0.0]], [[1.0]], [[-0.4]], [[0.0]])
    assert "pip install scipy" in certify_region(SCALAR, law, task(1, 1, 0.9)).reason


def test_no_kink_no_conewise_law():
    assert conewise_law(SCALAR, INC.saturated([[-0.2]], 1.0)) == NO_KINK
    assert certify_region(SCALAR, INC.saturated([[-0.2]], 1.0), task(1, 1, 0.9)).conewise is None


def corrupted(good):
    """Certificates with one thing wrong, and what must be said of it."""
    proof = good.conewise
    settling, cost, claim = proof.settling, proof.cost, proof.settling.claim
    yield replace(good, P=1.001 * good.P), "is not the one that the settling certificate speaks of"
    yield replace(good, P=None), "is not the one that the settling certificate speaks of"
    yield replace(good, level=1e12), "too large to stay away from"
    yield replace(good, conewise=None), ""

    def with_settling(part):
        other = ConewiseProof(part, cost)
        return replace(good, P=other.P, conewise=other)

    values = {name: 0.5 * value for name, value in settling.values.items()}
    yield with_settling(replace(settling, values=values)), "condition"
    wide = replace(settling.inc, activation=tuple(TwoSlopes(0.0, 0.5) for _ in range(settling.inc.q)))
    yield with_settling(replace(settling, inc=wide)), "speaks of another loop"
    yield with_settling(replace(settling, plant=Plant(0.5 * good.plant.A, good.plant.B))), "speaks of another loop"
    yield with_settling(replace(settling, claim=replace(claim, discount=0.9))), "does not bound the sum"
    yield with_settling(replace(settling, claim=replace(claim, Q=np.diag([1.0, 0.0])))), "does not bound the sum"
    for change in ({"Q": 0.5 * np.eye(2)}, {"R": [[0.05]]}, {"discount": 0.5}):
        cheap = replace(cost, claim=replace(cost.claim, **change))
        yield replace(good, conewise=ConewiseProof(settling, cheap)), "other weights or another discount"
    low = replace(cost, values={name: 0.5 * value for name, value in cost.values.items()})
    yield replace(good, conewise=ConewiseProof(settling, low)), "condition"
    light = replace(settling, claim=replace(claim, Q=0.5 * claim.Q))
    yield replace(good, conewise=ConewiseProof(light)), "does not cover the cost"


def test_corrupted_certificates_are_refused():
    plant, inc = bias_free(2, 1, 4, 5)
    limits = Box([-50.0], [50.0])
    good = certify_region(plant, inc, task(2, 1, 0.95, limits)).require()
    assert good.conewise.cost is not None
    assert replace(good, conewise=ConewiseProof(good.conewise.settling)).holds()  # M = Q answers for the cost too
    for bad, reason in corrupted(good):
        assert not bad.holds() and reason in bad.reason and not bad.prove(), reason


def test_only_certificates_of_discounted_costs_make_a_proof():
    law = INC([[0.0]], [[1.0]], [[-0.4]], [[0.0]])
    part = MatrixCertificate(SCALAR, law, Stability(0.9), "sector", {"P": [[1.0]], "Lambda": [1.0]})
    with pytest.raises(InvalidInputError, match="settling is .* but must be a certificate of a DiscountedCost"):
        ConewiseProof(part)
    cost = DiscountedCost([[1.0]], [[0.1]], 1.0, Gaussian([0.0], [[1.0]]))
    right = MatrixCertificate(SCALAR, law, cost, "sector", {"P": [[2.0]], "Lambda": [1.0]})
    with pytest.raises(InvalidInputError, match="cost is"):
        ConewiseProof(right, part)


@pytest.mark.parametrize("matrix, verdict", [
    ([[1.0, 1.0], [1.0, 1.0]], True), ([[0.0, 0.0], [0.0, 2.0]], True), ([[0.0, 1e-300], [1e-300, 1.0]], False),
    ([[1.0, 1.0 + 2**-52], [1.0 + 2**-52, 1.0]], False), ([[-1e-300]], False),
    ([[2.0, 1, 1], [1, 2, -1], [1, -1, 2.0]], True),
])
def test_semidefinite_matrices_at_the_edge(matrix, verdict):
    assert is_semidefinite(exact(np.array(matrix))) == verdict


def test_it_is_saved_checked_and_read_also_from_older_files(tmp_path, capsys):
    import json

    from inc_casadi.interchange.files import digest
    plant, inc = bias_free(2, 1, 4, 1)
    certificate = certify_region(plant, inc, task(2, 1, 0.95))
    certificate.save(tmp_path / "region.json")
    again = load(tmp_path / "region.json")
    assert again.sentence == certificate.sentence and again.gap == certificate.gap
    assert main(["check", str(tmp_path / "region.json")]) == 0 and "conewise linear loop" in capsys.readouterr().out
    affine = certify_region(SCALAR, INC.saturated([[-0.2]], 1.0), task(1, 1, 0.9))
    affine.save(tmp_path / "old.json")
    content = json.loads((tmp_path / "old.json").read_text())
    assert content["data"].pop("conewise") is None  # what files held before there was such a field
    content["digest"] = digest({key: content[key] for key in ("kind", "data")})
    (tmp_path / "old.json").write_text(json.dumps(content))
    assert load(tmp_path / "old.json").prove()
