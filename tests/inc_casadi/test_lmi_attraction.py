"""The convex programs behind ellipsoids: their answers without a loop's particulars, and many units at once."""

from __future__ import annotations

import numpy as np
import pytest
from attraction_draws import TWO_STATES, lqr

from inc_casadi import INC, Saturation, Tanh, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.lmi_attraction import largest
from inc_casadi.local.base import Setting
from inc_casadi.local.certify import certify_attraction
from inc_casadi.local.rest import rest_of


def setting(claim):
    loop = close_loop(TWO_STATES, INC.saturated(lqr(TWO_STATES), 1.0))
    return Setting(loop, claim, rest_of(loop))


@pytest.mark.parametrize("frame", [np.eye(2), np.array([[2.0, 0.3], [0.0, 0.5]])])
def test_an_upper_bound_on_the_matrix_is_the_best_ellipsoid(frame):
    # X <= diag(4, 1) in the frame: det X is largest, and every d'P d smallest, at the bound itself.
    def bounded(X, values):
        return {"bound": np.diag([4.0, 1.0]) - X}

    for claim in (Attraction(), Attraction(directions=[[1.0], [0.5]]), Attraction(directions=np.eye(2), shape="mean")):
        found = largest(setting(claim), (), bounded, frame)["X"]
        best, wanted = (claim.merit(np.linalg.inv(frame @ X @ frame.T)) for X in (found, np.diag([4.0, 1.0])))
        assert best == pytest.approx(wanted, abs=1e-5)


def test_contradictory_bounds_are_said_to_be_infeasible():
    assert "infeasible" in largest(setting(Attraction()), (), lambda X, values: {"below": -np.eye(2) - X}, np.eye(2))


def test_many_units_with_small_weights_shrink_the_ellipsoid_a_little():
    rng = np.random.default_rng(0)
    gain, q = lqr(TWO_STATES), 14
    U, weights = np.vstack([gain, 0.3 * rng.normal(size=(q - 1, 2))]), rng.normal(size=(1, q - 1))
    sizes = []
    for share in (0.0, 1e-4, 1e-2):
        inc = INC(np.zeros((q, q)), U, np.hstack([[[1.0]], share * weights]), 0 * gain,
                  activation=(Saturation(),) + (Tanh(),) * (q - 1))
        found = certify_attraction(TWO_STATES, inc, Attraction(), "dead zone")
        assert found.holds(), found.reason
        sizes.append(found.volume)
    alone = certify_attraction(TWO_STATES, INC.saturated(gain, 1.0), Attraction(), "dead zone").volume
    assert sizes[0] == pytest.approx(alone, rel=1e-2) and sizes[0] >= sizes[1] > sizes[2] > 0.1 * alone
