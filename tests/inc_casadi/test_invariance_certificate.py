"""Invariance by three methods that must agree: by hand, at the edge, against samples, and for what is not true."""

import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import draws
import numpy as np
import posed
import pytest

import inc_casadi
from benchmarks.baselines.saturated import saturated_lqr
from benchmarks.plants.paper import two_state
from inc_casadi import INC, Box, LeakyReLU, Plant, Polytope, ReLU, Saturation, Tanh, load
from inc_casadi.__main__ import main
from inc_casadi.blocks import exact
from inc_casadi.claims import Invariance
from inc_casadi.errors import DimensionError, FormatError, InvalidInputError, NotCertifiedError
from inc_casadi.invariance_certificate import METHODS, InvarianceCertificate, certify_invariance
from inc_casadi.mixed_integer import slacks_by_programs
from inc_casadi.output_bounds.invariance import slacks_by_bounds
from inc_casadi.pieces.invariance import slacks_by_pieces
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.walk import Budget

UNIT = Box([-1.0], [1.0])
HALF = INC.linear([[-0.5]])
PLANT = Plant([[1.0]], [[1.0]])
NUMPY_ALONE = """
import sys
from inc_casadi.__main__ import main
status = main(sys.argv[1:])
loaded = {"scipy", "cvxpy", "clarabel", "casadi"} & set(sys.modules)
assert not loaded, loaded
sys.exit(status)
"""
KINKED = (ReLU(), Saturation(), LeakyReLU(0.3))


def small_loop(seed):
    """A loop with n = 2 or 3, two inputs, p < n, W != 0 (under a multiplier T now and then), and a claim about it."""
    rng = np.random.default_rng(seed)
    n = 2 + seed % 2
    plant = draws.plant(rng, n=n, m=2, p=n - 1, radius=0.5)
    if seed % 5 < 3:  # contracting, so that the region may be invariant
        plant = Plant(plant.A * 0.4 / np.abs(plant.A).sum(axis=1).max(), plant.B, plant.C)
    inc = draws.controller(rng, m=2, p=n - 1, units=KINKED, gain=0.2, norm=0.8, bias=0.1)
    if seed % 4 == 3:
        inc = posed.controller(rng, KINKED, p=n - 1, m=2)
        inc = INC(inc.W, inc.U, 0.1 * inc.V, 0.1 * inc.K, inc.b, 0.1 * inc.d, inc.activations)
    region = Box(-np.ones(n), 1.5 * np.ones(n))
    if seed % 3 == 0:
        H = np.vstack([rng.normal(size=(n + 2, n)), np.eye(n), -np.eye(n)])
        region = Polytope(H, rng.uniform(1.0, 2.0, size=len(H)))
    return plant, inc, Invariance(region, Polytope([[1, 0.5], [-1, 0.2], [0, 1], [0.3, -1]], [1.0, 1.0, 1.0, 1.0]))


def sampled(plant, inc, claim, rng, count=4000):
    x = np.hstack([claim.region.sample(count, rng), claim.region.vertices])
    rows = claim.rows(plant)
    return (rows.t[:, None] - rows.E @ x - rows.G @ inc(plant.C @ x)).min(axis=1)


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 8))])
def test_three_methods_agree_and_no_sample_goes_beyond(seed):
    plant, inc, claim = small_loop(seed)
    exactly = slacks_by_pieces(PiecewiseLoop(plant, inc), claim)
    solver = slacks_by_programs(plant, inc, claim)
    bounds = slacks_by_bounds(plant, inc, claim, accuracy=2e-2)
    size = 2e-2 * (claim.rows(plant).t + np.abs(inc.d).sum() + 2)
    assert exactly.ended == solver.ended == bounds.ended == "" and inc.W.any()
    assert solver.least == pytest.approx(exactly.least, abs=1e-5)
    assert np.all(bounds.least <= exactly.least + 1e-9) and np.all(exactly.least - bounds.least <= size)
    met = sampled(plant, inc, claim, np.random.default_rng(seed))
    assert np.all(exactly.least <= met + 1e-9) and np.all(bounds.reached >= exactly.least - 1e-9)
    assert np.all(met - exactly.least < 0.35)
    for method in METHODS:
        certificate = InvarianceCertificate(plant, inc, claim, method)
        assert certificate.holds() == bool(np.all(exactly.least >= 0)), method
        assert certificate.holds() == certificate.prove().succeeded


def test_some_small_loops_hold_and_some_do_not():
    verdicts = [certify_invariance(*small_loop(seed)).holds() for seed in range(8)]
    assert any(verdicts) and not all(verdicts)


@pytest.mark.parametrize("seed", [0, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 3))])
def test_floats_find_what_fractions_do(seed):
    plant, inc, claim = small_loop(seed)
    rough, exactly = (slacks_by_pieces(PiecewiseLoop(plant, inc, kind), claim) for kind in ("float", "exact"))
    assert all(isinstance(slack, Fraction) for slack in exactly.least)
    assert rough.least == pytest.approx(exactly.least.astype(float), abs=1e-10)
    bounds = slacks_by_bounds(plant, inc, claim, accuracy=5e-2)
    assert all(Fraction(low) <= slack for low, slack in zip(bounds.least, exactly.least, strict=True))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("limit", "holds"), [(0.5 + 1e-4, True), (0.5 - 1e-4, False)])
def test_both_sides_of_an_input_limit(method, limit, holds):
    """u = -x / 2 on [-1, 1] needs |u| <= 1/2."""
    certificate = InvarianceCertificate(PLANT, HALF, Invariance(UNIT, Box([-limit], [limit])), method)
    assert certificate.holds() == holds and certificate.prove().succeeded == holds
    if holds:
        assert certificate.margins()["inputs"] <= 1e-4 + 1e-9 and certificate.counterexample is None
    else:
        row, point, excess = certificate.counterexample
        assert row in (0, 1) and excess <= 1e-4 and abs(HALF(point).item()) > limit and abs(point.item()) <= 1
        assert f"half-space {row} of the input set is exceeded by" in certificate.reason


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("A", "holds"), [(1.4999, True), (1.5001, False), (-0.4999, True), (-0.5001, False)])
def test_both_sides_of_leaving_the_region(method, A, holds):
    """x+ = (A - 1/2) x stays in [-1, 1] for A in [-1/2, 3/2]."""
    certificate = InvarianceCertificate(Plant([[A]], [[1.0]]), HALF, Invariance(UNIT), method)
    assert certificate.holds() == holds and certificate.prove().succeeded == holds
    assert ("half-space" in certificate.reason) == (not holds) and "inputs" not in certificate.margins()


def test_the_edge_itself_is_settled_in_fractions():
    """A slack of exactly zero: floats cannot tell, Fractions can, a solver's tolerance and bounds leave it open."""
    edge = Invariance(UNIT, Box([-0.5], [0.5]))
    certificate = certify_invariance(Plant([[1.5]], [[1.0]]), HALF, edge)
    assert certificate.method == "pieces" and certificate.holds() and certificate.prove().succeeded
    assert certificate.margins() == {"well-posed": 1.0, "inputs": 0.0, "next state": 0.0}
    assert certificate.prove().method == "exact fractions over all pieces"
    beyond = replace(certificate, claim=Invariance(UNIT, Box([-np.nextafter(0.5, 0)], [0.5])))
    assert not beyond.holds() and "exact arithmetic" in beyond.reason and not beyond.prove()
    solver, bounds = (replace(certificate, method=method) for method in ("mixed-integer", "bounds"))
    assert not solver.holds() and "too near 0 for the tolerance" in solver.reason
    assert not bounds.holds() and "less than rounding can tell" in bounds.reason and bounds.slacks.seconds < 5
    near = replace(solver, plant=PLANT, claim=Invariance(UNIT, Box([-0.5 - 1e-8], [0.5 + 1e-8])))
    assert not near.holds() and replace(near, method="pieces").holds() and replace(near, method="bounds").holds()


def test_a_limit_that_only_rounding_keeps_is_refused():
    """0.7 + 0.1 in floats is 2.8e-17 less than the sum of the two doubles, and that is the limit."""
    limit, law = 0.7 + 0.1, INC.linear([[0.7, 0.1]])
    claim = Invariance(Box([-1.0, -1.0], [1.0, 1.0]), Box([-limit], [limit]))
    certificate = InvarianceCertificate(Plant(0.5 * np.eye(2), [[0.1], [0.1]]), law, claim)
    assert certificate.slacks.least.min() == 0.0 and Fraction(0.7) + Fraction(0.1) > Fraction(limit)
    assert not certificate.holds() and "exact arithmetic" in certificate.reason and not certificate.prove()


def test_too_many_pieces_are_left_to_bounds():
    """Pieces end with their budget; auto then takes bounds, which need a few cells only, as there is slack."""
    rng = np.random.default_rng(0)
    inc = draws.controller(rng, m=1, p=2, units=(ReLU(),) * 12, gain=0.05)
    plant, claim = Plant(0.3 * np.eye(2), [[0.1], [0.1]]), Invariance(Box([-1.0, -1.0], [1.0, 1.0]), Box([-5.0], [5.0]))
    tight = Budget(pieces=5)
    pieces = InvarianceCertificate(plant, inc, claim, "pieces", tight)
    assert not pieces.holds() and "budget of 5 pieces" in pieces.reason and pieces.bound == -np.inf and not pieces.prove()
    found = certify_invariance(plant, inc, claim, budget=tight).require()
    assert found.method == "bounds" and "because of pieces" in found.note and "branch and bound" in found.prove().method


def test_a_proof_asks_for_well_posedness_without_rounding(monkeypatch):
    certificate = InvarianceCertificate(PLANT, HALF, Invariance(UNIT, UNIT))
    assert certificate.prove()
    monkeypatch.setattr("inc_casadi.invariance_certificate.is_proved", lambda *_: False)
    assert certificate.holds() and "not proved well posed" in certificate.prove().reason


def test_built_in_limits_hold_with_nothing_to_spare():
    claim = Invariance(UNIT, UNIT)
    for method in METHODS:
        certificate = InvarianceCertificate(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), claim, method)
        assert certificate.holds() and certificate.prove() and certificate.margins()["inputs"] == 0.0, method


def two_states(share=0.8, scale=1.0):
    """The paper's plant, its saturated LQR law, and {|K A^k x| <= share^k scale}: where sat is idle it shrinks by share."""
    case = two_state()
    inc = saturated_lqr(case.plant, case.spec)
    K = inc.V @ inc.U
    rows, M = [], np.eye(2)
    for k in range(20):
        rows.append(K @ M / share**k)
        M = (case.plant.A + case.plant.B @ K) @ M
    H = np.vstack([*rows, *(-row for row in rows)])
    corners = Polytope(H, np.full(len(H), scale)).vertices
    return case, inc, Invariance(Polytope.from_vertices(corners), case.spec.inputs)


@pytest.mark.parametrize("method", METHODS)
def test_an_invariant_polytope_of_the_two_state_plant(method):
    case, inc, claim = two_states(scale=1.1)
    certificate = InvarianceCertificate(case.plant, inc, claim, method).require()
    assert certificate.prove().succeeded and certificate.margins()["inputs"] == 0.0
    assert np.any(np.abs(inc.W @ inc.hidden(claim.region.vertices) + inc.U @ claim.region.vertices) > 1)  # sat is at work
    met = sampled(case.plant, inc, claim, np.random.default_rng(0))[claim.limits:].min()
    assert 0 < certificate.margins()["next state"] <= met + 1e-6
    assert method == "bounds" or met - certificate.margins()["next state"] < 1e-3
    assert str(certificate).startswith("From every state of the region the input lies within its limits")
    assert ("mixed-integer solver" in str(certificate)) == (method == "mixed-integer")


@pytest.mark.parametrize("method", METHODS)
def test_an_escape_is_told_with_a_true_point(method):
    case, inc, claim = two_states(scale=1.6)
    certificate = InvarianceCertificate(case.plant, inc, claim, method)
    row, point, excess = certificate.counterexample
    assert not certificate.holds() and not certificate.prove() and claim.name(row) in certificate.reason
    H, h = exact(claim.region.H), exact(claim.region.h)
    assert np.all(H @ exact(point) <= h)
    after = case.plant.A @ point + case.plant.B @ inc(point)
    beyond = (claim.region.H @ after - claim.region.h)[row - claim.limits]
    assert beyond == pytest.approx(excess, rel=1e-6) and excess > 0
    with pytest.raises(NotCertifiedError, match="is exceeded by"):
        certificate.require()


def test_a_tanh_loop_by_bounds_against_samples():
    case, _, claim = two_states(share=0.9, scale=0.3)
    K = saturated_lqr(case.plant, case.spec).U
    for size, holds in ((1.0, True), (1.15, False)):
        law = INC([[0.1, -0.2], [0.3, 0.0]], np.vstack([K, 0.3 * K]), [[0.9 * size, 0.2 * size]], np.zeros((1, 2)),
                  activation=Tanh())
        certificate = certify_invariance(case.plant, law, claim)
        met = sampled(case.plant, law, claim, np.random.default_rng(0))
        assert certificate.method == "bounds" and "Tanh() has no pieces" in certificate.note
        assert certificate.holds() == holds == bool(met.min() >= 0) == certificate.prove().succeeded, size
        found = slacks_by_bounds(case.plant, law, claim, accuracy=1e-3)
        assert np.all(found.least <= met) and np.all(found.reached - found.least <= 2e-3 * (1 + claim.rows(case.plant).t))
        assert np.all(met - found.reached < 1e-2)


def test_corrupted_certificates_are_refused_or_true():
    case, inc, claim = two_states(scale=1.1)
    for method in METHODS:
        good = InvarianceCertificate(case.plant, inc, claim, method).require()
        for change in ({"claim": replace(claim, inputs=Box([-0.9], [0.9]))},
                       {"plant": Plant(1.5 * case.plant.A, case.plant.B)},
                       {"claim": Invariance(Box([-2.0, -2.0], [2.0, 2.0]), claim.inputs)},
                       {"inc": INC.saturated(-inc.U, 1.0)}, {"inc": INC(2 + inc.W, inc.U, inc.V, inc.K)},
                       {"budget": Budget(seconds=0.0, pieces=1)}):
            bad = replace(good, **change)
            if method == "bounds" and "budget" in change:
                bad = replace(bad, claim=replace(claim, region=Polytope(0.999 * claim.region.H, claim.region.h)))
            assert not bad.holds() and bad.reason and not bad.prove(), (method, change)
            assert str(bad).startswith("Not certified")


def test_what_stands_in_the_way_is_said():
    claim = Invariance(UNIT, UNIT)
    unproved = InvarianceCertificate(PLANT, INC([[2.0]], [[1.0]], [[1.0]], [[0.0]]), claim)
    assert "not proved well posed" in unproved.reason and unproved.bound == -np.inf and np.isnan(unproved.worst[1]).all()
    flowing = InvarianceCertificate(Plant([[1.0]], [[1.0]], dt=0.0), HALF, claim)
    assert "discrete time" in flowing.reason and flowing.margins()["next state"] == -np.inf and not flowing.prove()
    curved = INC([[0.0]], [[-0.5]], [[1.0]], [[0.0]], activation=Tanh())
    assert "take the method 'bounds'" in InvarianceCertificate(PLANT, curved, claim).reason
    assert certify_invariance(PLANT, curved, claim).holds()
    with pytest.raises(InvalidInputError, match="method is 'magic'"):
        certify_invariance(PLANT, HALF, claim, "magic")
    with pytest.raises(InvalidInputError, match="needs an Invariance claim"):
        InvarianceCertificate(PLANT, HALF, UNIT)
    with pytest.raises(DimensionError):
        InvarianceCertificate(PLANT, HALF, Invariance(Box([-1, -1], [1, 1])))


@pytest.mark.parametrize("method", ["pieces", "bounds"])
def test_a_saved_certificate_comes_back_and_is_checked(method, tmp_path, capsys):
    path = tmp_path / "invariance.json"
    good = InvarianceCertificate(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), Invariance(UNIT, UNIT), method)
    good.save(path)
    again = load(path)
    assert again.sentence == good.sentence and again.margins() == good.margins() and again.prove()
    assert main(["check", str(path)]) == 0 and "Proved by" in capsys.readouterr().out
    done = subprocess.run([sys.executable, "-c", NUMPY_ALONE, "check", str(path)], capture_output=True, text=True,
                          timeout=60, env={"PYTHONPATH": str(Path(inc_casadi.__file__).parents[1])})
    assert done.returncode == 0 and good.sentence in done.stdout, done.stderr
    replace(good, inc=INC.saturated([[-1.5]], 1.1)).save(path)
    assert main(["check", str(path)]) == 1 and "is exceeded by" in capsys.readouterr().out
    path.write_text(path.read_text().replace(f'"{method}"', '"magic"'))
    with pytest.raises(FormatError):
        load(path)
