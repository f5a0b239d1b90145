"""Bounds on hidden units over an ellipsoid: sampled, against interval arithmetic by hand, and for feedback in W."""

import numpy as np
import pytest
from attraction_draws import rim
from neural_draws import MIXED, neural, two_layers

from inc_casadi import INC, Ellipsoid, Plant, Saturation, Tanh, close_loop
from inc_casadi.claims import Attraction
from inc_casadi.lmi_local_start import consistent_bounds
from inc_casadi.local import unit_bounds
from inc_casadi.local.base import Setting
from inc_casadi.local.rest import rest_of
from inc_casadi.local.unit_bounds import linearized, local_lines, near_rest, remainders


def setting_of(plant, inc):
    loop = close_loop(plant, inc)
    return Setting(loop, Attraction(), rest_of(loop))


def moves(setting, P, rng, N=4000):
    """Points of the ellipsoid (n, N), and the moves of pre-activations and hidden units there (q, N)."""
    inc, plant, center = setting.loop.inc, setting.loop.plant, setting.rest.center
    e = rim(Ellipsoid(P), N, rng) * rng.random(N) ** 0.3
    y = plant.C @ (center[:, None] + e)
    eta, z_rest = inc.hidden(y), near_rest(setting.rest)[0]
    z = inc.W @ eta + inc.U @ y + inc.b[:, None]
    eta_rest = inc.hidden(plant.C @ center)
    return e, z - z_rest[:, None], eta - eta_rest[:, None]


DRAWS = [dict(units=MIXED, n=3, m=2, bias=0.3, feedback=0.6), dict(feedback=0.9), dict(units=MIXED, bias=0.2, limit=1.0),
         dict(units=MIXED, n=3)]


@pytest.mark.parametrize("draw", DRAWS, ids=["feedback and biases", "strong feedback", "saturated output", "no feedback"])
@pytest.mark.parametrize("seed", [0, 1])
def test_no_sampled_unit_leaves_its_bound_its_lines_or_its_remainder(draw, seed):
    rng = np.random.default_rng(seed)
    setting = setting_of(*neural(rng, **draw))
    n, q = setting.loop.n, setting.loop.q
    P = np.eye(n) * 2.0 + 0.3
    r = consistent_bounds(setting, P, np.ones(q), np.ones(q, dtype=bool))
    e, z, eta = moves(setting, P, rng)
    assert np.all(np.abs(z) <= r[:, None] + 1e-9)
    bounds = linearized(setting, r, P)
    g = bounds.rows(setting.loop.Z[:, :n])
    assert np.all(np.abs(z) <= np.abs(g @ e) + bounds.slack[:, None] + 1e-9)
    found = local_lines(setting, r, np.zeros((q, n)))
    near, far = (part.astype(float)[:, None] for part in (found.near, found.far))
    assert np.all((eta - far * z) * (near * z - eta) >= -1e-9)
    for slope in (np.zeros(q), far[:, 0], (near[:, 0] + far[:, 0]) / 2):
        assert np.all(np.abs(eta - slope[:, None] * z) <= remainders(setting, r, slope)[:, None] + 1e-9)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_any_rows_give_true_bounds(monkeypatch, seed):
    rng = np.random.default_rng(seed)
    setting = setting_of(*neural(rng, MIXED, n=3, feedback=0.5))
    n, q = setting.loop.n, setting.loop.q
    P = 2.0 * np.eye(n)
    r = consistent_bounds(setting, P, np.ones(q), np.ones(q, dtype=bool))
    monkeypatch.setattr(unit_bounds, "_through", lambda W, slope: rng.normal(size=W.shape))
    e, z, _ = moves(setting, P, rng)
    bounds = linearized(setting, r, P)
    reach = np.abs(bounds.rows(setting.loop.Z[:, :n]) @ e) + bounds.slack[:, None]
    assert np.all(np.abs(z) <= reach + 1e-9)


def test_contributions_that_cancel_are_taken_as_they_are():
    # Two equal units with opposite signs: nothing reaches the third, whatever they do. Intervals cannot see it.
    W = np.zeros((3, 3))
    W[2, :2] = 1.0, -1.0
    inc = INC(W, [[1.0], [1.0], [0.1]], [[0.0, 0.0, 1.0]], [[0.0]], activation=Tanh())
    setting = setting_of(Plant([[1.1]], [[1.0]]), inc)
    r = consistent_bounds(setting, np.eye(1), np.ones(3), np.ones(3, dtype=bool))
    by_intervals = 0.1 + 2 * np.tanh(1.0)
    assert r[0] == pytest.approx(1.0, abs=1e-5) and 0.1 <= r[2] < 0.2 * by_intervals


def test_one_unit_that_feeds_back_by_hand():
    # z = x - eta/2 with eta = sat(z): z = 2x/3 inside, so |x| <= 1.5 reaches the kink; beyond, z = x - 1/2.
    inc = INC([[-0.5]], [[1.0]], [[1.0]], [[0.0]], activation=Saturation())
    setting = setting_of(Plant([[1.1]], [[1.0]]), inc)
    r = consistent_bounds(setting, np.array([[1.0]]), np.ones(1), np.array([True]))
    assert r == pytest.approx(2 / 3, abs=1e-4)          # linear: nothing but rounding is lost
    far = consistent_bounds(setting, np.array([[1 / 9]]), np.ones(1), np.array([True]))
    assert 2.5 <= far <= 3.5                            # x = 3 gives 2.5; the remainder costs the rest


def test_a_law_without_contraction_but_with_a_multiplier_has_bounds_too():
    inc = INC([[-1.2]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh())
    assert not inc.contraction.contracts and inc.well_posedness().holds
    setting = setting_of(Plant([[1.1]], [[1.0]]), inc)
    r = consistent_bounds(setting, np.array([[4.0]]), np.ones(1), np.array([True]))
    _, z, _ = moves(setting, np.array([[4.0]]), np.random.default_rng(0))
    assert np.max(np.abs(z)) <= r[0] <= 1.2 * np.max(np.abs(z))


def test_bounds_that_do_not_hold_leave_no_room():
    rng = np.random.default_rng(5)
    setting = setting_of(*two_layers(rng))
    q = setting.loop.q
    r = consistent_bounds(setting, np.eye(2), np.ones(q), np.ones(q, dtype=bool))
    g = linearized(setting, r, np.eye(2))
    assert np.all(np.linalg.norm(g.rows(setting.loop.Z[:, :2]), axis=1) <= g.rooms(r))
    small = r.copy()
    small[5:] = 1e-6                                    # the second layer cannot stay there while the first one moves
    g = linearized(setting, small, np.eye(2))
    assert np.any(np.linalg.norm(g.rows(setting.loop.Z[:, :2]), axis=1) > g.rooms(small))


def test_an_unbounded_unit_counts_with_the_width_of_its_range():
    inc = INC([[0.0, 0.0], [1.0, 0.0]], [[1.0], [1.0]], [[0.0, 1.0]], [[0.0]], activation=Tanh())
    setting = setting_of(Plant([[1.1]], [[1.0]]), inc)
    slack = linearized(setting, np.array([0.0, 3.0]), np.eye(1)).slack
    assert slack[1] == pytest.approx(1.0, abs=1e-9)
