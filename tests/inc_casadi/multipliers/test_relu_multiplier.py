"""The relu multiplier, sampled on graphs about the origin and about equilibria, by hand, and what it contains."""

import draws
import multiplier_draws as md
import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, Identity, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.errors import InvalidInputError
from inc_casadi.multipliers import Relu, Slope
from inc_casadi.multipliers.atoms import parts_of

RELU, SATURATION = ReLU(), Saturation()
GROUPS = {
    "ReLU": (RELU, RELU, RELU),
    "leaky": (LeakyReLU(0.3), RELU, md.CONCAVE, LeakyReLU(1.0)),
    "saturation": (SATURATION,) * 3,
    "dead zone": (md.DEAD_ZONE, SATURATION, md.DEAD_ZONE),
    "three kinks": (md.THREE, RELU, md.THREE),
    "mixed": (RELU, Tanh(), LeakyReLU(0.3), Identity(), md.CONCAVE, Tanh(), SATURATION, md.THREE, CenteredLogistic()),
}
RESTS = {
    "inside pieces": (-0.75, 0.5, 1.5, -2.0),
    "saturated": (-3.0, 2.0, 1.5, 4.0),
    "on kinks": (0.0, 1.0, -0.5, 0.25),
    "some of each": (0.5, -1.0, 1.0, 2.0),
}
BIASED = (RELU, SATURATION, md.DEAD_ZONE, md.THREE)


def looked_at(rng, units, *, N=2500, rest=None, dyadic=False):
    """A widened loop and points s on its graph, about the origin or about a rest at the given levels."""
    plant, inc = md.square_loop(rng, units, dyadic=dyadic, rest=rest)
    x = md.states_at(plant, inc, md.levels(units, rng, N) * (1 if rest is None else 2), rng)
    at_rest = None if rest is None else states_at_rest(plant, inc, rest)
    return Relu().widened(close_loop(plant, inc)), md.stack(plant, inc, x, columns=True, rest=at_rest)


def states_at_rest(plant, inc, rest):
    """x* = (I - A - B K C)^-1 B (V eta* + d)."""
    eta = md.values_of(inc.activations, np.array(rest)[:, None])[:, 0]
    return np.linalg.solve(np.eye(plant.n) - plant.A - plant.B @ inc.K @ plant.C, plant.B @ (inc.V @ eta + inc.d))


@pytest.mark.parametrize("units", GROUPS.values(), ids=GROUPS)
@pytest.mark.parametrize("seed", range(3))
def test_nonnegative_on_the_graph_about_the_origin(units, seed):
    rng = np.random.default_rng(seed)
    loop, s = looked_at(rng, units, dyadic=seed == 0)
    for k in range(12):
        values = md.drawn_values(rng, Relu(), loop, tight=k % 2 == 0)
        assert all(np.min(entries) >= -1e-10 for entries in Relu().signs(loop, values).values())
        assert md.smallest_value(Relu().matrix(loop, values), s) >= -1e-9


@pytest.mark.parametrize("rest", RESTS.values(), ids=RESTS)
@pytest.mark.parametrize("seed", range(3))
def test_nonnegative_on_the_graph_about_an_equilibrium(rest, seed):
    rng = np.random.default_rng(10 + seed)
    loop, s = looked_at(rng, (*BIASED, Identity()), rest=(*rest, 0.75), dyadic=True)
    assert loop.about == "rest" and [float(level) for level in loop.center] == [*rest, 0.75]
    for k in range(15):
        values = md.drawn_values(rng, Relu(), loop, tight=k % 2 == 0)
        assert md.smallest_value(Relu().matrix(loop, values), s) >= -1e-9


@pytest.mark.parametrize(
    ("units", "rest"), [*((units, None) for units in GROUPS.values()), *((BIASED, r) for r in RESTS.values())]
)
def test_every_sign_matters(units, rest):
    # One signed entry below zero, the sums paid all the same, or one sum below zero by itself: negative somewhere.
    rng = np.random.default_rng(5)
    loop, s = looked_at(rng, units, N=6000, rest=rest, dyadic=True)
    unknowns = Relu().unknowns(loop)
    zeros = {unknown.name: np.zeros(unknown.shape) for unknown in unknowns}
    for unknown in unknowns:
        for place in np.argwhere(unknown.signed if unknown.name in ("N", "N_g") else np.zeros(unknown.shape, dtype=bool)):
            value = np.zeros(unknown.shape)
            value[tuple(place)] = -1.0
            value = value + value.T if unknown.is_symmetric else value
            values = md.paid(rng, Relu(), loop, {**zeros, unknown.name: value})
            assert md.smallest_value(Relu().matrix(loop, values), s) < -1e-6, (unknown.name, place)
        for place in np.argwhere(unknown.free if unknown.name == "w" else np.zeros(unknown.shape, dtype=bool)):
            w = np.zeros(unknown.shape)
            w[tuple(place)] = -1.0
            assert min(np.min(sums) for sums in Relu().signs(loop, {**zeros, "w": w}).values()) < 0
            assert md.smallest_value(Relu().matrix(loop, {**zeros, "w": w}), s) < -1e-6


@pytest.mark.parametrize("rest", RESTS.values(), ids=RESTS)
def test_unsigned_entries_are_worth_nothing_on_the_graph(rest):
    rng = np.random.default_rng(6)
    loop, s = looked_at(rng, BIASED, rest=rest, dyadic=True)
    zeros = {unknown.name: np.zeros(unknown.shape) for unknown in Relu().unknowns(loop)}
    found = 0
    for unknown in Relu().unknowns(loop):
        if unknown.name not in ("N", "N_g"):
            continue
        for place in np.argwhere(unknown.free & ~unknown.signed):
            value = np.zeros(unknown.shape)
            value[tuple(place)] = 1.0
            value = value + value.T if unknown.is_symmetric else value
            values = md.paid(rng, Relu(), loop, {**zeros, unknown.name: value})
            M, found = Relu().matrix(loop, values), found + 1
            assert np.abs(M).max() > 0.1 and abs(md.smallest_value(M, s)) < 1e-9 and abs(md.smallest_value(-M, s)) < 1e-9
    assert found > 0


@pytest.mark.parametrize(("unit", "low", "high"), [(RELU, 0.0, 1.0), (LeakyReLU(0.25), 0.25, 1.0), (md.CONCAVE, 1.0, 0.25)])
def test_one_unit_by_hand(unit, low, high):
    # eta = low z + (high - low) p and z = p - n: 3 p^2 + 5 n^2 - 14 p n, off the graph too.
    loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.5]], [[2.0]], [[1.0]], [[0.0]], activation=unit))
    x, eta = 0.6, -1.1
    z = 2.0 * x + 0.5 * eta
    p, n = (eta - low * z) / (high - low), (eta - high * z) / (high - low)
    value = oracles.quadratic(Relu().matrix(loop, {"N": np.array([[3.0, -7.0], [-7.0, 5.0]])}), np.array([x, eta]))
    assert value == pytest.approx(3.0 * p**2 + 5.0 * n**2 - 14.0 * p * n)
    assert Relu().unknowns(loop)[0].signed.tolist() == [[True, False], [False, True]]


def test_one_resting_unit_by_hand():
    # eta = relu(z), at rest at z* = 2: h = n, g = p, g* = 2; with N = 3, w = 5: s'M s = 3 n^2 - 10 n p~, p~ = eta - 2.
    loop = Relu().widened(close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[0.0]], [[0.0]], b=[2.0])))
    assert [u.name for u in Relu().unknowns(loop)] == ["N", "w"] and loop.center.tolist() == [2]
    M = Relu().matrix(loop, {"N": np.array([[3.0]]), "w": np.array([5.0])})
    for x in (-7.0, -2.0, 1.0, 3.0):
        n, p = max(-x - 2.0, 0.0), max(x + 2.0, 0.0)
        assert oracles.quadratic(M, np.array([x, p - 2.0])) == pytest.approx(3 * n**2 - 10 * n * (p - 2.0))
    assert Relu().signs(loop, {"N": np.array([[3.0]]), "w": np.array([5.0])})["w g* - N_g g*"].tolist() == [[10.0]]


def test_products_of_different_units_are_nonnegative_only_with_the_right_sign():
    # p_1 n_2 >= 0 on the graph, h = (p_1, n_1, p_2, n_2), so N[0, 3] < 0 must be caught by the sign condition.
    inc = INC(np.zeros((2, 2)), [[1.0], [-1.0]], [[1.0, 1.0]], [[0.0]])
    loop = close_loop(Plant([[0.5]], [[1.0]]), inc)
    N = np.zeros((4, 4))
    N[0, 3] = N[3, 0] = 1.0
    assert oracles.quadratic(Relu().matrix(loop, {"N": N}), np.array([2.0, 2.0, 0.0])) == pytest.approx(8.0)
    signed = Relu().unknowns(loop)[0].signed
    assert signed.tolist() == [
        [True, False, True, True],
        [False, True, True, True],
        [True, True, True, False],
        [True, True, False, True],
    ]


@pytest.mark.parametrize("unit", [RELU, LeakyReLU(0.3), md.CONCAVE])
def test_contains_the_slope_multiplier_of_units_with_one_kink(unit):
    # sigma = (h - l) p and nu = (h - l) n', n' = -n, in one order or the other: 2 nu'T sigma = -2 (h - l)^2 n'T p.
    rng = np.random.default_rng(13)
    loop = close_loop(*md.square_loop(rng, (unit,) * 4))
    values = md.drawn_values(rng, Slope(), loop)
    T, (low, high) = np.diag(values["r"]) - values["O"], unit.slopes
    if unit.steepness[0] > unit.steepness[-1] if isinstance(unit, md.Bent) else False:
        T = T.T  # sigma lies to the left of the kink
    N = np.zeros((8, 8))
    N[1::2, 0::2] = -((high - low) ** 2) * T
    N = N + N.T
    assert np.all(N[Relu().unknowns(loop)[0].signed] >= 0)
    np.testing.assert_allclose(Relu().matrix(loop, {"N": N}), Slope().matrix(loop, values), atol=1e-12)


@pytest.mark.parametrize("odd", [False, True])
def test_contains_the_slope_multiplier_of_saturations(odd):
    # nu_i = p_i - n_i and eta_j = a_j - 1 = 1 - b_j: nu_i eta_i = p_i + n_i, and nu_i (eta_i -+ eta_j) are sums of
    # p_i b_j, n_i a_j for O, of p_i a_j, n_i b_j for E.
    rng = np.random.default_rng(14)
    loop = close_loop(*md.square_loop(rng, (SATURATION,) * 3))
    slope = md.drawn_values(rng, Slope(), loop)
    slope = {**slope, "O": slope["O"] * (not odd), "E": slope["E"] * odd}
    wide = Relu().widened(loop)
    parts = parts_of(wide)
    p, n, a, b = (3 * [None] for _ in range(4))
    for i in range(3):
        p[i], n[i] = 2 * i, 2 * i + 1  # h: up_2, down_1 of each unit
        a[i], b[i] = 2 * i, 2 * i + 1  # g: up_1, down_2
    N_g, w = np.zeros((6, 6)), np.zeros(6)
    for i in range(3):
        for j in range(3):
            N_g[p[i], b[j]] += slope["O"][i, j]
            N_g[n[i], a[j]] += slope["O"][i, j]
            N_g[p[i], a[j]] += slope["E"][i, j]
            N_g[n[i], b[j]] += slope["E"][i, j]
        w[p[i]] = w[n[i]] = slope["r"][i]
    values = {"N": np.zeros((6, 6)), "N_g": N_g, "w": w}
    assert parts.g_rest.tolist() == [1] * 6
    assert all(np.min(sums) >= -1e-12 for sums in Relu().signs(wide, values).values())
    pad = np.zeros((wide.width, wide.width))
    pad[: loop.width, : loop.width] = Slope().matrix(loop, slope)
    x = md.states_at(loop.plant, loop.inc, md.levels(loop.inc.activations, rng, 500), rng)
    s = md.stack(loop.plant, loop.inc, x, columns=True)
    np.testing.assert_allclose(oracles.quadratic(Relu().matrix(wide, values), s), oracles.quadratic(pad, s), atol=1e-9)


def test_refused_without_a_kink_or_without_an_exact_rest():
    rng = np.random.default_rng(14)
    curved = close_loop(
        draws.plant(rng), draws.controller(rng, units=(Tanh(), CenteredLogistic(), Identity(), LeakyReLU(1.0)))
    )
    assert "needs a hidden unit with a kink" in Relu().refusal(curved)
    biased = close_loop(draws.plant(rng), draws.controller(rng, units=(RELU, Logistic()), bias=1.0))
    assert "equilibrium" in Relu().refusal(biased)
    with pytest.raises(InvalidInputError, match="rational arithmetic"):
        Relu().widened(biased)
    for bias in (0.0, 1.0):
        assert (
            Relu().refusal(close_loop(draws.plant(rng), draws.controller(rng, units=(RELU, SATURATION), bias=bias))) is None
        )


def test_the_unknowns_that_straight_and_curved_units_bring():
    rng = np.random.default_rng(15)
    loop = Relu().widened(close_loop(*md.square_loop(rng, (RELU, Identity(), Tanh(), Tanh()))))
    assert {u.name: u.shape for u in Relu().unknowns(loop)} == {
        "N": (2, 2),
        "Y": (1, loop.width),
        "r": (2,),
        "O": (2, 2),
        "E": (2, 2),
    }
    Y = rng.normal(size=(1, loop.width))
    zeros = {u.name: np.zeros(u.shape) for u in Relu().unknowns(loop)}
    s = rng.normal(size=loop.width)
    off = (loop.H[1] - loop.Z[1]) @ s
    assert oracles.quadratic(Relu().matrix(loop, {**zeros, "Y": Y}), s) == pytest.approx(2 * off * (Y[0] @ s))


def test_curved_units_keep_the_slope_multiplier_as_it_is():
    # Beside it everything else is zero, so M is that of a loop in which only the curved units exist.
    rng = np.random.default_rng(16)
    plant, inc = md.square_loop(rng, (RELU, Tanh(), Identity(), Tanh()))
    loop = Relu().widened(close_loop(plant, inc))
    values = {u.name: np.zeros(u.shape) for u in Relu().unknowns(loop)}
    T = np.array([[2.0, -0.5], [-0.25, 1.0]])
    values = {**values, "r": np.diag(T), "O": np.array([[0.0, 0.5], [0.25, 0.0]])}
    z, eta = rng.normal(size=(2, 40)), rng.normal(size=(2, 40))
    s = np.linalg.pinv(np.vstack([loop.Z[[1, 3]], loop.H[[1, 3]]])) @ np.vstack([z, eta])
    by_hand = 2 * np.einsum("in,ij,jn->n", z - eta, T, eta)
    np.testing.assert_allclose(oracles.quadratic(Relu().matrix(loop, values), s), by_hand, atol=1e-9)
