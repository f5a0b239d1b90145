"""The assembled programs are the conditions in the frame, and a point of a solver is a set of values and back."""

import draws
import numpy as np
import pytest

from inc_casadi import (
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
from inc_casadi.lmi_assembly import LARGEST_SCALE, assembled
from inc_casadi.lmi_frame import Frame
from inc_casadi.multipliers import LADDER, Lifted, Sector

MIXED = (ReLU(), Saturation(), ReLU(), Tanh(), LeakyReLU(0.2))
COST = DiscountedCost(np.diag([1.0, 0.5]), [[0.2]], 0.95, Gaussian([0.3, -1.0], [[1.0, 0.2], [0.2, 2.0]]))
E = np.array([[1.0], [0.3]])


def loop(dt=1.0, bias=0.0, units=MIXED):
    rng = np.random.default_rng(11)
    return close_loop(draws.plant(rng, n=2, m=1, p=2, dt=dt), draws.controller(rng, m=1, p=2, units=units, bias=bias))


def nearby(plant):
    return Plant(0.9 * plant.A, 1.1 * plant.B, plant.C, plant.dt)


CLAIMS = {
    "stable": Stability(0.97), "cost": COST, "gain": L2Gain(E), "named gain": L2Gain(E, gain=9.0), "margins": Margins(0.3),
    "robust": Robust(COST, NormBounded(E, [[1.0, 0.5]], [[0.2]], size=0.2)),
    "sector": Robust(L2Gain(E), InputSector(0.5, 1.5)), "polytope": Polytopic(COST, (nearby(loop().plant),)),
    "together": Together((Stability(0.97), COST, L2Gain(E, gain=9.0))),
    "deviation": DeviationCost(np.eye(2), [[0.2]], 0.95, Box([-1, -1], [1, 2])),
}


def programs(name, multiplier, **kind):
    where, claim = loop(**kind), CLAIMS[name]
    if claim.refusal(where, multiplier):
        pytest.skip(claim.refusal(where, multiplier))
    return assembled(where, claim, multiplier)


@pytest.mark.parametrize("multiplier", LADDER, ids=lambda multiplier: multiplier.name)
@pytest.mark.parametrize("name", CLAIMS)
def test_blocks_are_the_conditions_in_the_frame(name, multiplier):
    parts, rng = programs(name, multiplier), np.random.default_rng(12)
    y = rng.normal(size=parts.widest().size - 1)
    lower, upper = parts._bounds
    y = np.where(lower == 0, np.abs(y), y)  # signed entries would be cut off otherwise
    values, inequalities = parts.values_at(y), parts.inequalities
    np.testing.assert_allclose(parts.point(values), y, rtol=1e-9, atol=1e-9)
    again = parts.values_at(parts.point(values))
    assert all(np.allclose(again[key], values[key], rtol=1e-9, atol=1e-9) for key in values)
    below = parts.values_at(-np.abs(y))  # what a solver leaves a hair below zero is cut off
    for unknown in inequalities.unknowns:
        value = values[unknown.name]
        assert np.all(value[~unknown.free] == 0) and np.all(below[unknown.name][unknown.signed] == 0)
        assert not unknown.is_symmetric or np.array_equal(value, value.T)
    shapes = [(condition, name) for name, condition in inequalities.conditions(values).items() if condition.size]
    assert len(shapes) == len(parts._blocks)
    for (condition, name), block in zip(shapes, parts._blocks, strict=True):
        graph = inequalities.graphs.get("positive" if name == "P" else name)
        S = parts.frame.back if graph is None else parts.frame.congruence(graph)
        expected, read = S.T @ condition @ S, block.value(y)
        np.testing.assert_allclose(read, expected, atol=1e-9 * max(1, np.max(np.abs(expected))))
        assert np.min(np.abs(np.linalg.det(S))) > 0
    rows, offset = parts._rows
    signs = [entries.reshape(-1) for entries in inequalities.signs(values).values()]
    np.testing.assert_allclose(rows @ y + offset, np.concatenate([np.zeros(0), *signs]), atol=1e-9)


@pytest.mark.parametrize("multiplier", [Sector(), Lifted()])
@pytest.mark.parametrize("name", ["cost", "gain", "robust", "together"])
def test_the_cheapest_minimizes_the_claims_objective_with_slack(name, multiplier):
    parts, rng = programs(name, multiplier), np.random.default_rng(13)
    plain, slack = parts.cheapest(), parts.cheapest(1e-3)
    inequalities, claim = parts.inequalities, parts.inequalities.claim
    y, z = (np.abs(rng.normal(size=plain.size)) for _ in range(2))
    goals = [claim.objective(inequalities.graphs, parts.values_at(point)).item() for point in (y, z)]
    costs = [plain.cost @ point for point in (y, z)]
    assert parts.minimizes and costs[0] / costs[1] == pytest.approx(goals[0] / goals[1], rel=1e-6)
    for one, other in zip(plain.blocks, slack.blocks, strict=True):
        np.testing.assert_allclose(one.value(y) - other.value(y), 1e-3 * np.eye(len(one.constant)), atol=1e-12)
    np.testing.assert_allclose(plain.offset - slack.offset, 1e-3)
    lower, upper = plain.lower, plain.upper
    assert np.all(upper > 0) and np.all((lower == 0) | (lower == -upper))
    np.testing.assert_array_equal(lower == 0, signed_places(parts))


def signed_places(parts):
    signed = np.zeros(parts.cheapest().size if parts.minimizes else parts.widest().size - 1, dtype=bool)
    for unknown in parts.inequalities.unknowns:
        index = parts._index[0][unknown.name]
        signed[index[unknown.signed]] = True
    return signed


@pytest.mark.parametrize("multiplier", [Sector(), Lifted()])
@pytest.mark.parametrize("name", ["stable", "cost", "named gain", "margins", "together"])
def test_the_widest_maximizes_the_smallest_eigenvalue(name, multiplier):
    parts, rng = programs(name, multiplier), np.random.default_rng(14)
    problem = parts.widest()
    y, t = np.abs(rng.normal(size=problem.size - 1)), 0.3
    point = np.append(y, t)
    assert problem.cost @ point == -t and problem.upper[-1] == 1.0 and problem.lower[-1] < -999
    for one, other in zip(parts._blocks, problem.blocks, strict=True):
        np.testing.assert_allclose(other.value(point), one.value(y) - t * np.eye(len(one.constant)), atol=1e-9)
    homogeneous = name in ("stable", "margins")
    sizes = [np.trace(S.T @ parts.values_at(y)[key] @ S) for key, S in parts._axes.items()]
    mean = sum(sizes) / sum(len(S) for S in parts._axes.values())
    assert (problem.rows @ point + problem.offset)[-1] == pytest.approx((1.0 if homogeneous else LARGEST_SCALE) - mean)


def test_no_unknown_can_run_away():
    parts = programs("cost", Lifted())
    lower, upper = parts._bounds
    assert np.all(np.isfinite(upper)) and np.all(upper > 0)
    effects = []
    for i in range(upper.size):
        e = np.zeros(upper.size)
        e[i] = upper[i]
        effects.append(max(np.linalg.norm(block.value(e) - block.constant) for block in parts._blocks))
    assert max(effects) < 1e7 and np.median(effects) > 1  # bounds in units of what an unknown does, wide ones


def test_a_claim_without_objective_has_none():
    assert not programs("stable", Sector()).minimizes and not programs("named gain", Sector()).minimizes


@pytest.mark.parametrize("name", ["stable", "cost", "deviation"])
def test_biased_and_given_frames(name):
    where = loop(bias=1.0, units=(ReLU(), Saturation(), LeakyReLU(0.2)))
    frame, rng = Frame(np.array([[2.0, 1.0], [0.0, 0.5]]), np.array([1.0, 2.0, 3.0])), np.random.default_rng(15)
    for multiplier in LADDER:
        if CLAIMS[name].refusal(where, multiplier):
            continue
        parts = assembled(where, CLAIMS[name], multiplier, frame)
        y = np.abs(rng.normal(size=parts.widest().size - 1))
        condition = parts.inequalities.conditions(parts.values_at(y))["decrease"]
        S = frame.congruence(parts.inequalities.graphs["decrease"])
        np.testing.assert_allclose(parts._blocks[1].value(y), S.T @ condition @ S, atol=1e-9 * np.max(np.abs(condition)))


def test_the_continuous_flow_is_assembled_in_one_term():
    parts = assembled(loop(dt=0.0), Stability(0.1), Sector())
    y = np.abs(np.random.default_rng(16).normal(size=parts.widest().size - 1))
    condition = parts.inequalities.conditions(parts.values_at(y))["decrease"]
    S = parts.frame.congruence(parts.inequalities.graphs["decrease"])
    np.testing.assert_allclose(parts._blocks[1].value(y), S.T @ condition @ S, atol=1e-9)
    n_terms = sum(term.index.shape == (2, 2) for term in parts._blocks[1].terms)
    assert n_terms == 2  # the flow with its transpose, and alpha X'PX
