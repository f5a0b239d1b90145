"""Stacks of several steps, sampled on motions: the multipliers over them, and the refusals."""

import draws
import multiplier_draws as md
import numpy as np
import pytest

from inc_casadi import INC, Gaussian, Identity, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.claims import DeviationCost, Stability
from inc_casadi.lmi_search import search
from inc_casadi.multipliers import Lifted, Relu, Sector, Slope

GROUPS = {
    "ReLU": (ReLU(), ReLU(), LeakyReLU(0.3)),
    "tanh": (Tanh(), Tanh(), md.Lopsided()),
    "mixed": (ReLU(), Tanh(), Saturation(), md.THREE, Identity(), Tanh()),
}
BIASED = (ReLU(), Saturation(), md.DEAD_ZONE, Identity())
RESTS = {"inside": (0.5, 1.5, -2.0, 1.0), "on kinks": (0.0, 1.0, -0.5, 0.25), "saturated": (-3.0, -2.0, 1.5, 0.0)}


def motions(rng, steps, units, *, rest=None, next_too=True):
    """A lifted loop (a step's, or that of V) and the stacks of motions that start with levels on and off kinks."""
    plant, inc = md.square_loop(rng, units, dyadic=True, rest=rest)
    loop = close_loop(plant, inc)
    x = md.states_at(plant, inc, md.levels(units, rng, 2000) * (1 if rest is None else 2), rng)
    eta = None if rest is None else md.values_of(units, np.array(rest)[:, None])[:, 0]
    at_rest = (
        None
        if rest is None
        else np.linalg.solve(np.eye(plant.n) - plant.A - plant.B @ inc.K @ plant.C, plant.B @ (inc.V @ eta + inc.d))
    )
    last = steps if next_too else steps - 1
    s = md.stack(plant, inc, x, steps=last, columns=any(unit.pieces is not None for unit in units), rest=at_rest)
    return Lifted(steps).step(loop) if next_too else Lifted(steps).now(loop), s


CASES = [*((units, None) for units in GROUPS.values()), *((BIASED, rest) for rest in RESTS.values())]


@pytest.mark.parametrize("next_too", [True, False])
@pytest.mark.parametrize("steps", [1, 2])
@pytest.mark.parametrize(("units", "rest"), CASES, ids=[*GROUPS, *RESTS])
def test_nonnegative_on_motions(units, rest, steps, next_too):
    rng = np.random.default_rng(30)
    loop, s = motions(rng, steps, units, rest=rest, next_too=next_too)
    assert loop.width == len(s) and loop.about == ("origin" if rest is None else "rest")
    for k in range(8):
        values = md.drawn_values(rng, Lifted(steps), loop, tight=k % 2 == 0)
        assert md.smallest_value(Lifted(steps).matrix(loop, values), s) >= -1e-9


@pytest.mark.parametrize("steps", [1, 2])
def test_links_join_one_unit_to_itself_at_other_steps_and_to_its_equals(steps):
    rng = np.random.default_rng(31)
    units = (Tanh(), md.Lopsided(), Tanh())
    loop = Lifted(steps).step(close_loop(*md.square_loop(rng, units)))
    unknowns = {unknown.name: unknown for unknown in Lifted(steps).unknowns(loop)}
    kinds = list(units) * (steps + 1)
    same = np.array([[a == b for b in kinds] for a in kinds]) & ~np.eye(len(kinds), dtype=bool)
    odd = np.array([kind == Tanh() for kind in kinds])
    assert np.array_equal(~unknowns["O"].zero, same)
    assert np.array_equal(~unknowns["E"].zero, same & odd[:, None] & odd[None, :])


def test_one_curved_unit_alone_is_linked_to_itself_one_step_on():
    rng = np.random.default_rng(32)
    loop = close_loop(*md.square_loop(rng, (Tanh(), md.Lopsided())))
    assert Slope().refusal(loop) is not None and Lifted().refusal(loop) is None
    assert (~dict((u.name, u) for u in Lifted().unknowns(Lifted().step(loop)))["O"].zero).sum() == 4


@pytest.mark.parametrize(
    ("bias", "dt", "units", "message"),
    [
        (0.0, 0.0, (ReLU(), Tanh()), "needs discrete time"),
        (1.0, 1.0, (ReLU(), Logistic()), "rational arithmetic"),
        (1.0, 1.0, (Tanh(), Tanh()), "needs a hidden unit with a kink"),
        (0.0, 1.0, (), "no hidden units"),
    ],
)
def test_refusals(bias, dt, units, message):
    rng = np.random.default_rng(33)
    loop = close_loop(draws.plant(rng, dt=dt), draws.controller(rng, units=units, bias=bias))
    assert message in Lifted().refusal(loop) and Lifted().steps == 1
    assert Lifted().refusal(close_loop(draws.plant(rng), draws.controller(rng, units=(ReLU(),), bias=bias))) is None


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("bias", "rungs"), [(0.0, (Sector(), Slope(), Relu(), Lifted())), (1.0, (Sector(), Relu(), Lifted()))]
)
def test_each_rung_is_at_least_as_strong_as_the_one_before(seed, bias, rungs):
    # Best bounds on the cost of one loop, by rung: ordered up to what the search leaves open, and not all the same.
    rng = np.random.default_rng(40 + seed)
    units = [(ReLU(),) * 3, (Saturation(),) * 2, (md.DEAD_ZONE, ReLU(), md.DEAD_ZONE)][seed]
    plant, inc = draws.plant(rng), draws.controller(rng, units=units, gain=0.12, bias=bias)
    claim = DeviationCost(np.eye(3), 0.1 * np.eye(2), 0.95, Gaussian(np.zeros(3), np.eye(3)))
    found = [search(plant, inc, claim, rung) for rung in rungs]
    bounds = [certificate.bound if certificate.holds() else np.inf for certificate in found]
    assert all(after <= before * (1 + 1e-5) for before, after in zip(bounds, bounds[1:], strict=False)), bounds
    assert np.isfinite(bounds[-1]) and bounds[-1] < bounds[0]


@pytest.mark.parametrize(("k", "expected"), [(0.15, (False, True, True)), (0.35, (None, False, True))])
def test_more_steps_prove_more(k, expected):
    # Example 3 of Carrasco et al., IEEE TAC 65(11), 2020, with a ReLU: none, one and three hidden vectors in V.
    num, den = [-1, 1.95, -0.9, -0.05], [1, -2.8, 3.5, -2.412, 0.7209]
    plant = Plant(np.vstack([-np.array(den[1:]), np.eye(3, 4)]), np.eye(4, 1), [num])
    inc = INC([[0.0]], [[1.0]], [[-k]], [[0.0]])
    for rung, verdict in zip((Relu(), Lifted(), Lifted(3)), expected, strict=True):
        assert verdict is None or search(plant, inc, Stability(1 - 1e-7), rung).holds() == verdict
