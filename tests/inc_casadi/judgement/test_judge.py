"""The judge: which way of proof passes, in which order, what each leaves open, and what the gate and a comparison read."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Ellipsoid, Gaussian, Plant, Saturation, Spec, Tanh, compare
from inc_casadi.ellipsoidal_region import EllipsoidalRegion
from inc_casadi.judgement import Cause, judge
from inc_casadi.judgement.ways import by_inequality, by_pieces
from inc_casadi.pieces.walk import Budget
from inc_casadi.regional_certificate import RegionalCertificate
from synthesis.gate import gate

STEEP, CALM, UNIT = Plant(1.5, 1.0), Plant([[0.7, 0.2], [0.0, 0.6]], [[0.0], [1.0]]), Box(-1, 1)
TANH = INC([[0.0]], [[1.6]], [[-1.0]], [[0.0]], activation=Tanh())


def steep(initial=UNIT):
    return Spec(1.0, 0.1, 0.9, initial, UNIT)


def ways(found):
    return [(one.way, getattr(one, "cause", None)) for one in found.findings]


def test_what_pieces_prove_is_enough():
    found = judge(STEEP, steep(), INC.saturated([[-1.5]], 1.0))
    assert ways(found) == [("exact pieces", None)] and found.best.exact
    assert isinstance(found.best.certificate, RegionalCertificate)
    assert found.best.limits and found.best.converges and np.isfinite(found.best.worst)


def test_curved_units_on_an_unstable_plant_pass_by_an_ellipsoid():
    found = judge(STEEP, steep(), TANH)
    assert ways(found) == [("exact pieces", Cause.SMOOTH), ("global LMI", Cause.HOPELESS), ("ellipsoid", None)]
    assert isinstance(found.best.certificate, EllipsoidalRegion) and found.best.bound <= found.best.worst


def test_an_ellipsoid_of_initial_states_goes_to_the_ellipsoid():
    found = judge(STEEP, steep(Ellipsoid([[1.0]])), INC.saturated([[-1.5]], 1.0))
    assert found.best.way == "ellipsoid" and found.best.certificate.prove()


def test_a_motion_that_was_seen_to_diverge_ends_the_search():
    found = judge(STEEP, steep(Box(-2.5, 2.5)), INC.saturated([[-1.5]], 1.0))
    assert ways(found) == [("exact pieces", Cause.LOST), ("global LMI", Cause.HOPELESS)] and found.best is None


def test_the_ellipsoid_is_not_asked_where_the_inequality_holds():
    spec = Spec(np.eye(2), 1.0, 0.95, Box([-1, -1], [1, 1]), UNIT)
    net = INC.from_layers([([[-0.3, -0.2]], [0.0]), ([[0.3]], [0.0])], Tanh())
    found = judge(CALM, spec, net)
    assert ways(found) == [("exact pieces", Cause.SMOOTH), ("global LMI", None)]
    assert found.built_in and found.best.converges.startswith("The loop is globally exponentially stable")


def test_alone_means_that_limits_kept_by_invariance_do_not_count():
    spec = Spec(np.eye(2), 1.0, 0.95, Box([-1, -1], [1, 1]), UNIT)
    leaning = INC([[0.0]], [[-0.3, -0.2]], [[0.3]], [[0.0, -0.05]], activation=Tanh())  # its range is unbounded
    together, alone = (judge(CALM, spec, leaning, alone=alone, ways=(by_pieces, by_inequality)) for alone in (False, True))
    assert together.best.grounds and together.best.limits == "the initial set is invariant within them"
    assert alone.best is None and "not built into" in alone.refused[-1].why


def test_an_inequality_without_limits_is_no_best():
    spec = Spec(np.eye(2), 1.0, 0.95, Box([-1, -1], [1, 1]), UNIT)
    falling = INC([[0.0]], [[-0.3, -0.2]], [[0.3]], [[-0.9, -0.9]], activation=Tanh())  # 1.8 + 0.3 tanh(0.5) from a corner
    found = judge(CALM, spec, falling, ways=(by_pieces, by_inequality))
    assert found.best is None and found.passed[0].bound == np.inf and "not invariant" in found.passed[0].short[0]


def test_an_ill_posed_law_is_refused_before_anything_is_evaluated():
    found = judge(STEEP, steep(), INC([[1.5]], [[1.0]], [[1.0]], [[0.0]]))
    assert [one.cause for one in found.refused] == [Cause.ILL_POSED] and "1.5" in found.posed


def test_the_ellipsoid_takes_what_time_the_pieces_leave():
    found = judge(STEEP, steep(), TANH, Budget(seconds=0.0))
    assert ways(found)[-1] == ("ellipsoid", Cause.TIME) and found.best is None


def test_unbounded_initial_states_are_refused_by_name():
    found = judge(STEEP, steep(Gaussian([0.0], [[1.0]])), TANH)
    assert ways(found)[-1] == ("ellipsoid", Cause.HOPELESS) and "unbounded" in found.refused[-1].why


def test_gate_and_comparison_read_the_same_judgement():
    laws = {"tanh": TANH, "clipped": INC.saturated([[-1.5]], 1.0), "wide": INC.saturated([[-1.5]], 1.2)}
    shown = compare(STEEP, steep(), laws, bounds=[], samples=100)
    for name, law in laws.items():
        verdict, row = gate(STEEP, steep(), law), shown.row(name)
        assert verdict.accepted == row.certified and verdict.cost == pytest.approx(row.bound)
        assert set(verdict.refusals[:1]) <= set(row.notes)
    assert shown.row("tanh").cost.words.startswith("an ellipsoid of attraction") and shown.row("tanh").worst > 1.0
    assert shown.row("wide").limits.verdict == "violated"


def test_a_law_with_a_net_before_its_saturation_needs_no_pieces():
    inner = INC([[0.0]], [[1.0]], [[-1.7]], [[0.0]], b=[0.0], activation=Tanh())
    law = inner.with_saturated_output(UNIT)
    found = judge(STEEP, steep(Box(-0.8, 0.8)), law)
    assert isinstance(law.activations[-1], Saturation) and found.best.way == "ellipsoid" and found.best.certificate.prove()
