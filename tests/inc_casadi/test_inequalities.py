"""A claim with a multiplier for each graph: names, shares, signs."""

import draws
import numpy as np

from inc_casadi import (
    INC,
    Box,
    DiscountedCost,
    L2Gain,
    LeakyReLU,
    Plant,
    ReLU,
    Saturation,
    Stability,
    Together,
    close_loop,
)
from inc_casadi.inequalities import Inequalities, named, own_values
from inc_casadi.multipliers import LADDER, Lifted, Relu, Sector, Slope, Unknown

COST = DiscountedCost(np.eye(2), [[1.0]], 0.9, Box([-1.0, -1.0], [1.0, 1.0]))


def loop():
    rng = np.random.default_rng(5)
    return close_loop(draws.plant(rng, n=2, m=1, p=2), draws.controller(rng, m=1, p=2, units=(ReLU(), Saturation(), ReLU())))


def test_the_step_keeps_its_names_and_the_others_say_which():
    assert named("N", "decrease") == "N" and named("N", "positive") == "N (positive)"
    parts = Inequalities(loop(), COST, Lifted())
    assert list(parts.graphs) == ["decrease", "positive", "initial"]
    names = [unknown.name for unknown in parts.unknowns]
    assert names[:2] == ["P", "P_0"] and {"N", "N (positive)", "N (initial)"} <= set(names) and len(set(names)) == len(names)


def test_each_graph_has_a_multiplier_of_its_own():
    rng, parts = np.random.default_rng(6), Inequalities(loop(), COST, Lifted())
    values = {u.name: np.where(u.free, rng.normal(size=u.shape), 0.0) for u in parts.unknowns}
    values = {u.name: values[u.name] + values[u.name].T if u.is_symmetric else values[u.name] for u in parts.unknowns}
    before = parts.conditions(values)
    touched = {"": "decrease", " (positive)": "P", " (initial)": "initial"}
    for suffix, condition in touched.items():
        after = parts.conditions({**values, "N" + suffix: 2 * values["N" + suffix]})
        assert {name for name in before if not np.array_equal(before[name], after[name])} == {condition}
    own = own_values(values, parts.of_graph["positive"], "positive")
    assert set(own) == {u.name for u in parts.of_graph["positive"]} and own["N"] is values["N (positive)"]


def test_signs_carry_the_name_of_their_graph():
    biased = INC([[0.0]], [[1.0]], [[0.2]], [[0.0]], b=[1.0], activation=LeakyReLU(0.3))
    parts = Inequalities(close_loop(Plant([[0.5]], [[1.0]]), biased), Stability(0.9), Lifted())
    signs = parts.signs(parts.zeros())
    assert len(signs) == 2 and {name.endswith("(positive)") for name in signs} == {True, False}
    assert not Inequalities(loop(), Stability(0.9), Sector()).signs({"P": np.eye(2), "Lambda": np.ones(3)})


def test_zero_values_leave_the_constant_part():
    for multiplier in LADDER:
        parts = Inequalities(loop(), COST, multiplier)
        zeros = parts.zeros()
        assert {name: value.shape for name, value in zeros.items()} == {u.name: u.shape for u in parts.unknowns}
        G = parts.graphs["decrease"].G
        X = np.eye(2, G.shape[1])
        np.testing.assert_allclose(parts.conditions(zeros)["decrease"], -X.T @ X - G.T @ G)


def test_masks_survive_the_renaming():
    parts = Inequalities(loop(), Together((Stability(0.9), L2Gain(np.eye(2)))), Relu())
    inner = {u.name: u for u in Relu().unknowns(parts.graphs["decrease [2]"])}
    outer = {u.name: u for u in parts.unknowns}
    for name, unknown in inner.items():
        twin = outer[f"{name} (decrease [2])"]
        assert isinstance(twin, Unknown) and twin.kind == unknown.kind and twin.shape == unknown.shape
        np.testing.assert_array_equal(twin.signed, unknown.signed)
        np.testing.assert_array_equal(twin.free, unknown.free)
    slopes = {u.name: u for u in Inequalities(loop(), Stability(0.9), Slope()).unknowns}
    assert not slopes["O"].free.all() and slopes["O"].free.any()
