"""The slope multiplier, sampled on graphs, its links by hand, and what it contains."""

from dataclasses import dataclass

import draws
import multiplier_draws as md
import numpy as np
import oracles
import pytest

from inc_casadi import INC, CenteredLogistic, LeakyReLU, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.lifting import unrolled
from inc_casadi.multipliers import Sector, Slope
from inc_casadi.multipliers.relu import about_rest


@dataclass(frozen=True)
class Odd(md.Bent):
    """A piecewise-affine unit that says that it is odd."""

    @property
    def odd(self):
        return True


ODD_DEAD_ZONE = Odd((-1.0, 1.0), (1.0, 0.0, 1.0))
GROUPS = {
    "repeated ReLU": (ReLU(),) * 4,
    "repeated tanh": (Tanh(),) * 4,
    "repeated saturation": (Saturation(),) * 3,
    "odd and not": (ReLU(), Tanh(), ReLU(), Saturation(), Tanh(), Saturation(), LeakyReLU(0.3)),
    "curved, not odd": (md.Lopsided(),) * 3,
    "dead zones": (md.DEAD_ZONE,) * 2 + (ODD_DEAD_ZONE,) * 3,
    "negative slopes": (md.THREE, md.THREE, CenteredLogistic(), md.THREE),
}


def names(units, **kind):
    plant, inc = md.square_loop(np.random.default_rng(0), units, **kind)
    return {unknown.name: unknown for unknown in Slope().unknowns(close_loop(plant, inc))}


@pytest.mark.parametrize("units", GROUPS.values(), ids=GROUPS)
@pytest.mark.parametrize("seed", range(3))
def test_nonnegative_on_the_graph_kinks_included(units, seed):
    rng = np.random.default_rng(seed)
    plant, inc = md.square_loop(rng, units, dyadic=seed == 0)
    loop = close_loop(plant, inc)
    s = md.stack(plant, inc, md.states_at(plant, inc, md.levels(units, rng, 3000), rng))
    for k in range(12):
        values = md.drawn_values(rng, Slope(), loop, tight=k % 2 == 0)
        assert all(np.min(entries) >= -1e-12 for entries in Slope().signs(loop, values).values())
        assert md.smallest_value(Slope().matrix(loop, values), s) >= -1e-9


def test_who_is_linked_to_whom():
    linked = ~names(GROUPS["odd and not"])["O"].zero
    kinds = [type(unit) for unit in GROUPS["odd and not"]]
    expected = np.array([[i != j and a is b for j, b in enumerate(kinds)] for i, a in enumerate(kinds)])
    assert np.array_equal(linked, expected)
    odd = np.array([kind in (Tanh, Saturation) for kind in kinds])
    assert np.array_equal(~names(GROUPS["odd and not"])["E"].zero, expected & odd[:, None] & odd[None, :])
    assert (
        ~names((LeakyReLU(0.3), LeakyReLU(0.2), LeakyReLU(0.3)))["O"].zero[0, 2]
        and names((LeakyReLU(0.3), LeakyReLU(0.2), LeakyReLU(0.3)))["O"].zero[0, 1]
    )


def test_odd_links_for_odd_units_only():
    assert "E" in names(GROUPS["repeated tanh"]) and "E" in names(GROUPS["repeated saturation"])
    for units in ("repeated ReLU", "curved, not odd", "negative slopes"):
        assert "E" not in names(GROUPS[units]) and "O" in names(GROUPS[units])


@pytest.mark.parametrize(
    ("unit", "z", "holds"),
    [
        (ReLU(), (1.0, -1.0), False),
        (md.Lopsided(), (3.0, -3.0), False),
        (Tanh(), (2.0, -2.0), True),
        (Saturation(), (2.0, -2.0), True),
    ],
)
def test_an_odd_link_is_false_where_the_unit_is_not_odd(unit, z, holds):
    # nu'T sigma with T = [[1, 1], [1, 1]], by hand: sigma = phi(z), nu = z - phi(z) for slopes in [0, 1].
    plant, inc = md.square_loop(np.random.default_rng(1), (unit, unit), dyadic=True)
    loop = close_loop(plant, inc)
    z = np.array(z)[:, None]
    sigma = md.values_of(inc.activations, z)[:, 0]
    by_hand = 2 * (z[:, 0] - sigma) @ np.ones((2, 2)) @ sigma
    assert (by_hand >= -1e-12) == holds
    link = {"r": np.ones(2), "O": np.zeros((2, 2)), "E": np.eye(2)[::-1]}
    s = md.stack(plant, inc, md.states_at(plant, inc, z, np.random.default_rng(1)))
    assert oracles.quadratic(Slope().matrix(loop, link), s)[0] == pytest.approx(by_hand, abs=1e-12)


@pytest.mark.parametrize("units", GROUPS.values(), ids=GROUPS)
def test_every_sign_matters(units):
    # With one signed entry below zero by itself, s'M s < 0 somewhere on the graph.
    rng = np.random.default_rng(5)
    plant, inc = md.square_loop(rng, units, dyadic=True)
    loop = close_loop(plant, inc)
    s = md.stack(plant, inc, md.states_at(plant, inc, md.levels(units, rng, 4000) * 2, rng))
    zeros = {unknown.name: np.zeros(unknown.shape) for unknown in Slope().unknowns(loop)}
    for unknown in Slope().unknowns(loop):
        for place in np.argwhere(unknown.signed):
            if unknown.name == "r" and isinstance(units[place[0]], (ReLU, LeakyReLU)):
                continue  # nu sigma = 0 for one unit of this kind, so that its r has either sign; `Relu` knows
            value = np.zeros(unknown.shape)
            value[tuple(place)] = -1.0
            assert md.smallest_value(Slope().matrix(loop, {**zeros, unknown.name: value}), s) < -1e-3, (unknown.name, place)


@pytest.mark.parametrize("link", ["O", "E"])
@pytest.mark.parametrize(
    ("unit", "r", "short", "z"),
    [(Saturation(), (0.9, 1.0), "row", (20.0, 1.0)), (ODD_DEAD_ZONE, (1.0, 0.9), "column", (1.0, 20.0))],
)
def test_a_sum_that_is_too_small_by_hand(link, unit, r, short, z):
    # nu_1 (r_1 sigma_1 - sigma_2) + r_2 nu_2 sigma_2 for a link from 2 to 1: saturated, sigma_1 = sigma_2 = 1, nu = (19, 0);
    # past the dead zone, nu_1 = nu_2 = 1, sigma = (0, 19). An odd link does the same for z_2 of the other sign.
    loop = close_loop(*md.square_loop(np.random.default_rng(2), (unit, unit), dyadic=True))
    values = {"r": np.array(r), "O": np.zeros((2, 2)), "E": np.zeros((2, 2))}
    values[link][0, 1] = 1.0
    assert [short in name for name, sums in Slope().signs(loop, values).items() if np.min(sums) < 0] == [True]
    z = np.array([z]).T * [[1.0], [1.0 if link == "O" else -1.0]]
    s = md.stack(loop.plant, loop.inc, md.states_at(loop.plant, loop.inc, z, np.random.default_rng(2)))
    assert oracles.quadratic(Slope().matrix(loop, values), s)[0] == pytest.approx(2 * -0.1 * 19)
    assert np.min([np.min(sums) for sums in Slope().signs(loop, {**values, "r": np.ones(2)}).values()]) == 0


def test_contains_the_sector_multiplier_narrow_sectors_too():
    rng = np.random.default_rng(6)
    units = (ReLU(), Tanh(), ReLU(), md.THREE, Tanh())
    loop = close_loop(*md.square_loop(rng, units))
    Lambda, zero = rng.exponential(size=5), np.zeros((5, 5))
    inside = Slope().matrix(loop, {"r": Lambda, "O": zero, "E": zero})
    np.testing.assert_allclose(inside, Sector().matrix(loop, {"Lambda": Lambda}), atol=1e-12)
    narrow = close_loop(*md.square_loop(rng, (Narrow(), Narrow())))
    assert [unknown.shape for unknown in Slope().unknowns(narrow) if unknown.name == "Lambda"] == [(2,)]
    values = {"r": np.zeros(2), "O": np.zeros((2, 2)), "Lambda": Lambda[:2]}
    np.testing.assert_allclose(Slope().matrix(narrow, values), Sector().matrix(narrow, {"Lambda": Lambda[:2]}), atol=1e-12)


class Narrow(md.Bent):
    """Slopes in [-0.25, 1] but values between 0 and z: the sector is narrower than the slope range."""

    def __init__(self):
        super().__init__((0.0, 1.0, 2.0, 3.0), (0.5, 1.0, -0.25, 0.0, 0.5))

    @property
    def sector(self):
        return (0.125, 1.0)


def test_nonnegative_with_a_narrow_sector():
    rng = np.random.default_rng(7)
    z = np.linspace(-20, 20, 4001)[1::2]
    assert np.all((Narrow()(z) - 0.125 * z) * (z - Narrow()(z)) >= -1e-12)
    plant, inc = md.square_loop(rng, (Narrow(), Narrow(), Tanh()), dyadic=True)
    loop = close_loop(plant, inc)
    s = md.stack(plant, inc, md.states_at(plant, inc, md.levels(inc.activations, rng, 3000), rng))
    for _ in range(10):
        assert md.smallest_value(Slope().matrix(loop, md.drawn_values(rng, Slope(), loop)), s) >= -1e-9


def test_refused_where_it_says_nothing_new():
    rng = np.random.default_rng(8)
    alone = close_loop(*md.square_loop(rng, (ReLU(), Tanh(), Saturation())))
    assert "no two of ReLU(), Saturation(), Tanh() are one" in Slope().refusal(alone)
    biased = close_loop(draws.plant(rng), draws.controller(rng, units=(ReLU(), ReLU()), bias=1.0))
    assert "biased loop" in Slope().refusal(biased)
    assert Slope().refusal(close_loop(*md.square_loop(rng, (ReLU(), ReLU())))) is None
    empty = close_loop(Plant(0.5 * np.eye(3), np.ones((3, 2))), INC.linear(np.zeros((2, 3))))
    assert "has 0 of them in all" in Slope().refusal(empty)


def test_about_an_equilibrium_a_unit_is_linked_to_itself_at_another_step_only():
    # The deviation functions of two units with one activation differ where their levels at rest do.
    rng, rest = np.random.default_rng(9), (0.5, -0.75, 1.5)
    units = (Saturation(),) * 3
    plant, inc = md.square_loop(rng, units, dyadic=True, rest=rest)
    loop = unrolled(about_rest(close_loop(plant, inc)), 1, next_too=True)
    unknowns = {unknown.name: unknown for unknown in Slope().unknowns(loop)}
    assert np.array_equal(~unknowns["O"].zero, np.kron(1 - np.eye(2), np.eye(3)) > 0) and "E" not in unknowns
    eta = md.values_of(units, np.array(rest)[:, None])[:, 0]
    at_rest = np.linalg.solve(np.eye(4) - plant.A - plant.B @ inc.K @ plant.C, plant.B @ (inc.V @ eta + inc.d))
    x = md.states_at(plant, inc, 2 * md.levels(units, rng, 2000), rng)
    s = md.stack(plant, inc, x, steps=1, rest=at_rest)
    for k in range(8):
        values = md.drawn_values(rng, Slope(), loop, tight=k % 2 == 0)
        assert md.smallest_value(Slope().matrix(loop, values), s) >= -1e-9
