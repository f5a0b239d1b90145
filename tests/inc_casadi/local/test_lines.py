"""The two lines that a hidden unit stays between: sampled on its graph, with both sides of the room."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import oracles
import pytest

from inc_casadi import INC, Identity, LeakyReLU, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.local.base import Setting
from inc_casadi.local.lines import lines
from inc_casadi.local.rest import Rest


def setting_at(unit, rest, width=0.0):
    """A loop of one unit that is said to rest at a pre-activation, known up to a width."""
    loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], b=[0.5], activation=unit))
    zero, z = np.array([Fraction(0)]), np.array([Fraction(rest)])
    return Setting(loop, Attraction(), Rest(zero, zero, z - Fraction(width), z + Fraction(width), zero, zero))


def between(value, one, other):
    return (value - one) * (other - value)


@pytest.mark.parametrize("unit", [Saturation(), ReLU(), LeakyReLU(0.3)])
@pytest.mark.parametrize("rest", [-1.7, -0.4, 0.25, 1.3])
def test_a_unit_lies_between_its_lines_for_every_h_within_the_room(unit, rest):
    found = lines(setting_at(unit, rest))
    near, far, bend, room = (float(part[0]) for part in (found.near, found.far, found.bend, found.room))
    deviation = np.linspace(-6, 6, 2401)
    eta = oracles.phi(unit, rest + deviation) - oracles.phi(unit, np.array(rest))
    for h in np.linspace(-room, room, 9):
        assert np.min(between(eta, far * deviation + bend * h, near * deviation)) >= -1e-12
    if bend:  # an h beyond the room does not serve, on the side of the nearest kink
        h = 1.05 * room
        worst = min(np.min(between(eta, far * deviation + bend * sign * h, near * deviation)) for sign in (-1, 1))
        assert worst < -1e-4 * room


@pytest.mark.parametrize(("unit", "rest", "wanted"), [
    (Saturation(), "1/4", ("1", "0", "1", "3/4")), (Saturation(), 2, ("1", "0", "0", "0")),
    (Saturation(), 1, ("1", "0", "0", "0")), (ReLU(), 0, ("1", "0", "0", "0")), (ReLU(), 3, ("1", "0", "1", "3")),
    (ReLU(), -3, ("0", "1", "-1", "3")), (LeakyReLU(0.25), -1, ("1/4", "1", "-3/4", "1")),
    (Identity(), 5, ("1", "1", "0", "0")), (Tanh(), 0, ("1", "0", "0", "0")),
])
def test_the_lines_of_known_units(unit, rest, wanted):
    found = lines(setting_at(unit, rest))
    assert tuple(str(part[0]) for part in (found.near, found.far, found.bend, found.room)) == wanted


def test_an_equilibrium_known_up_to_a_width_has_less_room():
    assert lines(setting_at(Saturation(), 0.25, 0.125)).room[0] == Fraction(5, 8)
    assert lines(setting_at(ReLU(), 0.25, 0.25)).bent == []
