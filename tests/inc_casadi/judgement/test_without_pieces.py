"""The ways of proof that follow no pieces: laws that never switch, and laws that are clipped for a few moves."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Gaussian, Plant, Polytope, Saturation, Spec, Tanh, Uniform, compare
from inc_casadi.judgement import Cause, judge
from inc_casadi.linear import ClippedCost, UnswitchedCost
from inc_casadi.pieces.walk import Budget
from synthesis.gate import gate

STEEP, UNIT = Plant(1.5, 1.0), Box(-1, 1)
TEN = Plant(0.8 * np.eye(10) + 0.1 * np.eye(10, k=1), np.eye(10, 1, -9))
TEN_SPEC = Spec(np.eye(10), 1.0, 0.98, Box(-np.ones(10), np.ones(10)), Box(-0.3, 0.3))
SEVERAL = -0.04 * np.ones((1, 10))


def steep(initial=UNIT, inputs=UNIT):
    return Spec(1.0, 0.1, 0.9, initial, inputs)


def ways(found):
    return [(one.way, getattr(one, "cause", None)) for one in found.findings]


@pytest.mark.parametrize("law", [INC.linear([[-1.0]]), INC.saturated([[-1.0]], 1.0)])
def test_a_law_that_never_switches_is_settled_by_lyapunov_alone(law):
    found = judge(STEEP, steep(), law)
    assert ways(found) == [("Lyapunov", None)] and found.best.exact and isinstance(found.best.certificate, UnswitchedCost)
    assert found.best.worst == pytest.approx(1.1 / (1 - 0.9 / 4), rel=1e-9)


def test_a_linear_law_beyond_its_limits_is_refused_by_name_and_then_by_pieces():
    found = judge(STEEP, steep(), INC.linear([[-1.5]]), alone=True)
    assert ways(found)[:2] == [("Lyapunov", Cause.LIMITS), ("exact pieces", Cause.LIMITS)] and found.best is None
    assert "an input leaves facet" in found.refused[0].why


@pytest.mark.parametrize("law, first", [(INC.saturated([[-1.5]], 1.0), "exact pieces"),
                                        (INC([[0.0]], [[1.0]], [[-1.2]], [[0.0]], activation=Tanh()), "exact pieces")])
def test_laws_that_switch_or_curve_leave_no_word(law, first):
    assert judge(STEEP, steep(), law).findings[0].way == first


def test_with_many_states_bounded_clipping_is_asked_before_pieces():
    law = INC.saturated(SEVERAL, 0.3)
    assert np.max(np.abs(SEVERAL).sum()) > 0.3  # clipped at a corner
    found = judge(TEN, TEN_SPEC, law, Budget(seconds=1.0))
    assert ways(found) == [("bounded clipping", None)] and isinstance(found.best.certificate, ClippedCost)
    assert not found.best.exact and found.best.bound < found.best.worst


def test_with_few_states_it_is_asked_where_pieces_give_nothing():
    found = judge(STEEP, steep(), INC.saturated([[-1.2]], 1.0), Budget(seconds=0.0))
    assert ways(found)[:2] == [("exact pieces", Cause.TIME), ("bounded clipping", None)]
    assert found.passed[0].loose and found.best.bound == min(one.bound for one in found.passed)
    corner = Uniform(Polytope([[1.0], [-1.0]], [1.0, 1.0]))
    assert judge(STEEP, steep(corner), INC.saturated([[-1.2]], 1.0)).best.way == "exact pieces"


def test_the_gate_takes_both_and_looks_no_further():
    never, seldom = gate(STEEP, steep(), INC.saturated([[-1.0]], 1.0)), gate(TEN, TEN_SPEC, INC.saturated(SEVERAL, 0.3))
    assert never.settled and seldom.settled and never.certificate.prove() and seldom.certificate.prove()
    assert any(words.startswith("input limits kept on every motion") for words in seldom.proofs)


def test_without_limits_a_linear_law_converges_from_everywhere():
    found = judge(STEEP, Spec(1.0, 0.1, 0.9, Gaussian([0.0], [[1.0]])), INC.linear([[-1.0]]))
    assert ways(found) == [("Lyapunov", None)] and found.best.converges and np.isnan(found.best.worst)


def test_an_unstable_loop_is_refused():
    found = judge(STEEP, steep(), INC.linear([[-0.4]]))
    assert isinstance(found.refused[0].certificate, UnswitchedCost) and found.best is None


def test_a_comparison_reads_them():
    laws = {"never": INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], activation=Saturation())}
    row = compare(STEEP, steep(), laws, bounds=[]).rows[0]
    assert row.certified and row.cost.how == "exact" and row.bound == pytest.approx(1.1 / 3 / (1 - 0.9 / 4), rel=1e-9)
