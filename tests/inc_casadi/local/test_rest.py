"""Where a loop rests, and the rooms that limits leave there, in fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, ReLU, Saturation, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.local.base import Setting, input_rows, no_room, state_rows
from inc_casadi.local.checks import exact_conditions, rounded_conditions
from inc_casadi.local.convex_hull import ConvexHull
from inc_casadi.local.frames import first_frame
from inc_casadi.local.rest import Rest, rest_of


def fractions(*values):
    return np.array([Fraction(value) for value in values], dtype=object)


def test_a_biased_loop_rests_at_a_fraction():
    # By hand: x = x/2 + relu(x/4 + 1), so x/4 = 1.
    rest = rest_of(close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[0.25]], [[1.0]], [[0.0]], b=[1.0], activation=ReLU())))
    assert rest.x_low[0] == 4 and rest.z_high[0] == 2 and rest.u_low[0] == 2 and rest.center.tolist() == [4.0]


def test_rooms_take_the_worst_end_of_what_is_known():
    rest = Rest(fractions(-1, 0), fractions(1, 0), fractions(0), fractions("1/2"), fractions("1/4"), fractions("3/4"))
    assert rest.state_room(np.array([[2.0, 1.0], [-1.0, 0.0]]), np.array([5.0, 1.0])).tolist() == [3, 0]
    assert rest.input_room(np.array([[-2.0]]), np.array([1.0])).tolist() == [Fraction(3, 2)]
    assert rest.unit_room(-1.0, 1.0).tolist() == [Fraction(1, 2)]
    assert rest.center.tolist() == [0.0, 0.0]


def test_limits_that_are_built_in_are_not_proved_again():
    loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    built_in, tighter = (Setting(loop, Attraction(Box([-u], [u]), Box([-3], [2])), rest_of(loop)) for u in (1.0, 0.9))
    assert len(input_rows(built_in)[1]) == 0 and input_rows(tighter)[1].tolist() == [Fraction(0.9)] * 2
    assert state_rows(built_in)[1].tolist() == [2, 3] and no_room(tighter) is None
    outside = Setting(loop, Attraction(Box([0.1], [0.9])), rest_of(loop))
    assert "input limit number 1" in no_room(outside)


@pytest.mark.parametrize("bias", [0.0, 0.25])
def test_all_readings_of_a_condition_agree(bias):
    loop = close_loop(Plant([[1.5]], [[1.0]]), INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], b=[bias], activation=Saturation()))
    claim = Attraction(Box([-0.9], [0.8]), Box([-3], [2]), [[1.0]], [[0.3]], 0.9, 0.95)
    setting, values = Setting(loop, claim, rest_of(loop)), {"P": np.eye(1), "P_cost": 5 * np.eye(1), "H": np.array([[-0.7]])}
    plain = ConvexHull().conditions(setting, values)
    for name, entry in exact_conditions(ConvexHull(), setting, values).items():
        assert float(entry.fractions()[0, 0]) == pytest.approx(plain[name].item(), rel=1e-14)
    for name, entry in rounded_conditions(ConvexHull(), setting, values).items():
        assert abs(entry.value - plain[name]).item() <= entry.error.item() < 1e-12


def test_the_first_frame_follows_units_and_copes_with_an_unstable_law():
    loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-0.1]], 1.0))
    assert first_frame(Setting(loop, Attraction(), rest_of(loop))).tolist() == [[1.0]]
    scaled = close_loop(Plant([[0.5]], [[1.0]]), INC.saturated([[-1e-6]], 1.0))
    assert first_frame(Setting(scaled, Attraction(), rest_of(scaled))).item() > 1e5
