"""Three solvers, two formulations, one answer: on every claim and rung, infeasible problems included."""

import sys

import draws
import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    DeviationCost,
    DiscountedCost,
    Gaussian,
    InputSector,
    L2Gain,
    LeakyReLU,
    Margins,
    NormBounded,
    Plant,
    Polytopic,
    ReLU,
    Robust,
    Saturation,
    Stability,
    Tanh,
    Together,
    close_loop,
)
from inc_casadi.errors import InvalidInputError, SolverError
from inc_casadi.lmi_cvxpy import cvxpy_search
from inc_casadi.lmi_search import search
from inc_casadi.multipliers import LADDER, Sector

COST = DiscountedCost(np.diag([1.0, 0.5]), [[0.2]], 0.95, Gaussian(np.zeros(2), np.eye(2)))
E = np.array([[1.0], [0.3]])
BOX = NormBounded([[0.1], [0.1]], [[1.0, 0.5]], size=0.3)


UNITS = (ReLU(), Saturation(), ReLU(), Tanh())


def loop(dt=1.0, bias=0.0, units=UNITS, gain=0.1):
    rng = np.random.default_rng(21)
    plant = draws.plant(rng, n=2, m=1, p=2, dt=dt, radius=0.7)
    return plant, draws.controller(rng, m=1, p=2, units=units, bias=bias, gain=gain)


def near(plant):
    return Plant(0.97 * plant.A, 1.1 * plant.B, plant.C, plant.dt)


FEASIBLE = {
    "stable": (Stability(0.9), {}), "cost": (COST, {}), "gain": (L2Gain(E), {}), "margins": (Margins(0.2), {}),
    "robust cost": (Robust(COST, InputSector(0.7, 1.3)), {}), "robust gain": (Robust(L2Gain(E), BOX), {}),
    "polytope": (Polytopic(L2Gain(E), (near(loop()[0]),)), {}),
    "together": (Together((Stability(0.95), COST, L2Gain(E))), {}),
    "deviation": (DeviationCost(np.eye(2), [[0.2]], 0.95, Box([-1, -1], [1, 2])),
                  {"bias": 1.0, "units": (ReLU(), LeakyReLU(0.2))}),
    "flow": (Stability(0.2), {"dt": 0.0}), "flow gain": (L2Gain(E), {"dt": 0.0}),
}


@pytest.mark.slow
@pytest.mark.parametrize("multiplier", LADDER, ids=lambda multiplier: multiplier.name)
@pytest.mark.parametrize("name", FEASIBLE)
def test_three_solvers_agree(name, multiplier):
    claim, kind = FEASIBLE[name]
    plant, inc = loop(**kind)
    refusal = claim.refusal(close_loop(plant, inc), multiplier)
    if refusal:
        pytest.skip(refusal)
    ours, clarabel = (search(plant, inc, claim, multiplier, solver=solver) for solver in ("interior point", "clarabel"))
    reference, status = cvxpy_search(plant, inc, claim, multiplier)
    assert ours.holds() and ours.prove() and clarabel.holds() and status in ("optimal", "optimal_inaccurate")
    assert clarabel.bound == pytest.approx(ours.bound, rel=1e-4)
    assert reference.bound == pytest.approx(ours.bound, rel=1e-4)


INFEASIBLE = {
    "too fast": Stability(0.5), "too small": L2Gain(E, gain=0.9), "too much": Margins(1.9),
    "far too uncertain": Robust(Stability(), NormBounded(E, [[1.0, 0.5]], size=3.0)),
    "too far": Polytopic(Stability(0.9), (Plant([[1.2, 0.0], [0.0, 0.2]], [[1.0], [0.0]], loop()[0].C),)),
    "one of two": Together((Stability(0.9), L2Gain(E, gain=0.9))),
}


@pytest.mark.parametrize("name", INFEASIBLE)
def test_none_finds_what_is_not_there(name):
    claim, (plant, inc) = INFEASIBLE[name], loop()
    for multiplier in LADDER:
        if claim.refusal(close_loop(plant, inc), multiplier):
            continue
        for found in (*(search(plant, inc, claim, multiplier, solver=solver) for solver in ("interior point", "clarabel")),
                      cvxpy_search(plant, inc, claim, multiplier)[0]):
            assert not found.holds() and not found.surely() and not found.prove()


def test_an_infeasible_objective_leaves_zeros():
    unstable = Plant([[1.5]], [[1.0]])
    claim = DiscountedCost([[1.0]], [[1.0]], 1.0, Box([-1.0], [1.0]))
    found, status = cvxpy_search(unstable, INC.linear([[0.0]]), claim, Sector())
    assert status == "infeasible" and not found.holds() and found.values["P"].tolist() == [[0.0]]
    assert "infeasible" in found.note


def test_it_wants_a_level_and_says_what_is_missing(monkeypatch):
    plant, law = Plant([[0.5]], [[1.0]]), INC.linear([[0.0]])
    with pytest.raises(InvalidInputError, match="Stability leaves its level open: name it"):
        cvxpy_search(plant, law, Stability(), Sector())
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(SolverError, match="pip install cvxpy clarabel"):
        cvxpy_search(plant, law, Stability(0.9), Sector())
