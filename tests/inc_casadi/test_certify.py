"""The verb: which rung it takes, what it refuses, and that it never certifies what simulation refutes."""

import re
import sys

import draws
import numpy as np
import oracles
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, Tanh, certify
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.claims import DiscountedCost, Stability
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.multipliers import LADDER, Lifted, Relu, Sector, Slope

PLANT = Plant([[1.2]], [[1.0]])
LAW = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
COST = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))


def test_auto_takes_the_strongest_rung_and_says_how_each_fared():
    found = certify(PLANT, LAW, COST)
    assert found.multiplier in (Relu(), Lifted()) and found.holds()
    rungs = r"sector: bound 0\.43351\d+; slope: bound 0\.4\d+; relu: bound 0\.35814\d*; lifted: bound 0\.35814\d*"
    assert re.fullmatch(rungs, found.note)
    each = [certify(PLANT, LAW, COST, multiplier=rung) for rung in LADDER]
    assert found.bound == min(one.bound for one in each) and all(one.prove() for one in each)
    assert each[0].bound >= each[1].bound * (1 - 1e-6) >= each[2].bound * (1 - 2e-6)
    assert certify(PLANT, LAW, COST, multiplier="sector").multiplier == Sector()
    assert certify(PLANT, LAW, COST, multiplier=Relu()).bound == pytest.approx(found.bound, rel=1e-5)


def test_auto_stops_at_the_first_rung_that_proves_a_given_rate():
    assert certify(PLANT, LAW, Stability(0.5)).note == "sector: bound 0.5"
    below = certify(PLANT, LAW, Stability(0.1))  # the sector's best is 0.463, the loop's own 0.0174
    assert below.multiplier == Relu() and below.prove() and below.note.startswith("sector: no certificate found")
    assert not certify(PLANT, LAW, Stability(0.01)).holds()


def test_auto_keeps_the_weaker_rung_when_the_stronger_finds_nothing(monkeypatch):
    from inc_casadi import lmi_search
    module, search = sys.modules["inc_casadi.certify"], lmi_search.search

    def sector_only(plant, inc, claim, multiplier, **how):
        if multiplier != Sector():
            return lmi_search.unsolved(plant, inc, claim, multiplier, "")
        return search(plant, inc, claim, multiplier, **how)

    monkeypatch.setattr(module, "search", sector_only)
    found = certify(PLANT, LAW, COST)
    assert found.holds() and found.multiplier == Sector()
    assert re.fullmatch(r"sector: bound 0\.43351\d+; (\w+: no certificate found(; |$)){3}", found.note)


def test_auto_falls_back_where_relu_does_not_apply():
    tanh = INC([[0.1]], [[1.0]], [[-0.2]], [[0.0]], activation=Tanh())
    found = certify(Plant([[0.9]], [[1.0]]), tanh, COST)
    assert found.holds() and found.multiplier == Sector() and "relu: not tried" in found.note
    refused = certify(Plant([[0.9]], [[1.0]]), tanh, COST, multiplier="relu")
    assert not refused.holds() and not refused.prove()
    assert "relu was asked for" in refused.note and "needs a hidden unit with a kink" in refused.note


def test_no_search_is_made_for_an_ill_posed_controller(monkeypatch):
    monkeypatch.setattr(sys.modules["inc_casadi.certify"], "search", None)
    ill = INC([[1.0]], [[1.0]], [[0.1]], [[0.0]])
    for claim in (Stability(), Stability(0.9), COST):
        found = certify(PLANT, ill, claim)
        assert not found.holds() and not found.prove() and "not proved well posed" in found.reason


def test_accepts_a_control_state_space():
    control = pytest.importorskip("control")
    found = certify(control.ss([[1.2]], [[1.0]], [[1.0]], [[0.0]], True), LAW, COST)
    assert found.prove() and found.plant.A.tolist() == [[1.2]]


def test_refusals_at_the_door():
    with pytest.raises(InvalidInputError, match="'circle', but must be a Multiplier or one of 'sector', 'slope', "
                                                "'relu', 'lifted'"):
        certify(PLANT, LAW, COST, multiplier="circle")
    with pytest.raises(InvalidInputError, match="inc must be an INC"):
        certify(PLANT, np.eye(2), COST)
    with pytest.raises(InvalidInputError, match="claim must be"):
        certify(PLANT, LAW, "stable")
    with pytest.raises(InvalidInputError, match="plant"):
        certify(np.eye(2), LAW, COST)
    with pytest.raises(DimensionError):
        certify(Plant(np.eye(2), np.ones((2, 1))), LAW, COST)
    with pytest.raises(InvalidInputError, match="rate = 0 must be positive"):
        certify(Plant([[1.2]], [[1.0]], dt=0), LAW, Stability(0.0))


def with_hidden(certificate, x):
    """What V is quadratic in along states (n, N, T): x, or (x, eta_0) on the lifted rung."""
    plant, inc = certificate.plant, certificate.inc
    if len(certificate.values["P"]) == plant.n:
        return x
    eta = [oracles.hidden(inc, plant.C @ x[..., k]) for k in range(x.shape[-1])]
    return np.concatenate([x, np.stack(eta, axis=-1)])


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(4, 8))])
def test_what_holds_is_true_on_trajectories(seed):
    """Random loops from harmless to unstable: whatever is certified must be seen, and what diverges never is."""
    rng = np.random.default_rng(seed)
    plant = draws.plant(rng, radius=rng.uniform(0.5, 0.95))
    inc = draws.controller(rng, gain=10.0 ** rng.uniform(-2, 0.5), norm=rng.uniform(0.2, 0.95))
    x0 = draws.points(rng, plant.n, 200)
    x, u = oracles.roll_out(plant, inc, x0, 40)
    stable = certify(plant, inc, Stability(0.98))
    if stable.holds():
        assert stable.prove()
        V = oracles.quadratic(stable.values["P"], with_hidden(stable, x))
        assert np.all(V[:, 1:] <= 0.98**2 * V[:, :-1] * (1 + 1e-9) + 1e-300)
    else:
        assert not stable.prove()
    claim = DiscountedCost(np.diag([1.0, 0.2, 0.5]), 0.1 * np.eye(2), 0.9, Box(-np.ones(3), np.ones(3)))
    cost = certify(plant, inc, claim)
    if cost.holds():
        assert cost.prove()
        paid = oracles.discounted_cost(x, u, claim.Q, claim.R, claim.discount)
        form = cost.values.get("P_0", cost.values["P"])
        assert np.all(paid <= oracles.quadratic(form, x0) * (1 + 1e-9))


def test_a_loop_that_diverges_is_never_certified():
    rng = np.random.default_rng(71)
    seen = 0
    for _ in range(5):
        plant, inc = draws.plant(rng, radius=0.95), draws.controller(rng, gain=4.0)
        x, _ = oracles.roll_out(plant, inc, draws.points(rng, plant.n, 30), 60)
        if np.max(np.abs(x[..., -1])) > 10 * np.max(np.abs(x[..., 0])):
            seen += 1
            found = certify(plant, inc, Stability(0.999))
            assert not found.holds() and not found.prove()
    assert seen >= 3


def test_no_hidden_unit_at_all():
    plant = Plant(np.diag([0.5, 0.2, -0.3]), np.ones((3, 2)))
    law = INC.linear(np.zeros((2, 3)))
    for claim in (Stability(0.6), DiscountedCost(np.eye(3), np.eye(2), 1.0, Box(-np.ones(3), np.ones(3)))):
        found = certify(plant, law, claim)
        assert found.holds() and found.prove()
    flow = certify(Plant(np.diag([-0.5, -0.2, -3.0]), np.ones((3, 2)), dt=0), law, Stability(0.39))
    assert flow.prove()


@pytest.mark.parametrize("solver", ["interior point", "clarabel"])
def test_the_solver_is_a_choice_that_does_not_change_the_answer(solver):
    found = certify(PLANT, LAW, COST, multiplier="relu", solver=solver)
    assert found.prove() and found.bound == pytest.approx(certify(PLANT, LAW, COST, multiplier="relu").bound, rel=1e-5)


def test_an_unknown_solver_is_refused():
    with pytest.raises(InvalidInputError, match="solver is 'mosek', but must be one of 'auto', 'interior "
                                                "point', 'clarabel'"):
        certify(PLANT, LAW, COST, solver="mosek")


def test_the_ladder():
    assert [rung.name for rung in LADDER] == ["sector", "slope", "relu", "lifted"]
    assert certify(PLANT, LAW, Stability(0.5), multiplier="slope").multiplier == Slope()
    assert certify(PLANT, LAW, Stability(0.5), multiplier=Lifted(2)).multiplier == Lifted(2)
    assert isinstance(certify(PLANT, LAW, Stability(0.5)), MatrixCertificate)


def test_a_loop_too_large_for_every_rung_is_refused_with_the_reason():
    found = certify(Plant(0.5 * np.eye(60), np.ones((60, 1))), INC.linear(np.zeros((1, 60))), Stability(0.6))
    assert not found.holds() and "ask for it by name" in found.note


def test_the_reason_names_what_stood_in_the_way_of_a_search():
    tanh = INC([[0.1]], [[1.0]], [[-0.2]], [[0.0]], activation=Tanh())
    refused = certify(Plant([[0.9]], [[1.0]]), tanh, Stability(0.95), multiplier="relu")
    assert "relu was asked for, but the relu multiplier needs a hidden unit with a kink" in refused.reason
    shifted = INC([[0.1]], [[1.0]], [[-0.2]], [[0.0]], d=[1.0], activation=Tanh())
    biased = certify(Plant([[0.9]], [[1.0]]), shifted, COST)
    assert "equilibrium x*" in biased.reason and "no search was made" in biased.note
