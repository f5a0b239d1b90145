"""The error bound of a rounded walk, against motions that are really disturbed and laws that are really prolonged."""

from dataclasses import replace

import numpy as np
import posed
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, Regional, ReLU, Saturation
from inc_casadi.pieces.enclosure import Arrival, Enclosure, Step, enclose
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.terminal import find, in_fractions, in_places
from inc_casadi.pieces.walk import walk
from inc_casadi.regional_certificate import certify_region

N, M, P, Q = 3, 2, 2, 5


def draw(seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    plant = Plant(0.6 * A / np.max(np.abs(np.linalg.eigvals(A))), rng.standard_normal((N, M)), rng.standard_normal((P, N)))
    W = rng.standard_normal((Q, Q))
    W *= 0.7 / np.abs(W).sum(axis=1, keepdims=True)
    inc = INC(W, 0.3 * rng.standard_normal((Q, P)), 0.2 * rng.standard_normal((M, Q)), 0.05 * rng.standard_normal((M, P)),
              rng.standard_normal(Q), activation=(ReLU(), LeakyReLU(0.3), Saturation(), ReLU(), Saturation()))
    return plant, INC(inc.W, inc.U, inc.V, inc.K, inc.b, -inc(np.zeros(P)), inc.activations)


def setting(seed):
    plant, inc = draw(seed)
    claim = Regional(Box(-np.ones(N), np.ones(N)), None, np.diag([1.0, 0.5, 2.0]), np.diag([0.3, 1.0]), 0.9)
    loop = PiecewiseLoop(plant, inc)
    terminal, why = find(loop, claim)
    assert terminal is not None, why
    return plant, inc, claim, loop, terminal


def quiet(x, u, rounds=0, beyond=0.0):
    return Step(rounds, beyond, x, u, np.inf, 1.0, 1)


def ends(pieces=1, n=N):
    return Arrival(pieces, np.ones(n), 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_disturbed_motions_stay_within_the_bound_and_so_do_their_costs(seed):
    """x^+ = A x^ + B inc(C x^) + e with |e| <= r is what a walk that rounds computes."""
    plant, inc, claim, loop, terminal = setting(seed)
    rng = np.random.default_rng(10 + seed)
    x = rng.uniform(-1, 1, (N, 400))
    steps = [quiet(np.ones(N), np.ones(M))] * 6
    r = enclose(loop, claim, terminal, steps, ends(), 1e-9).rounding
    size, cost, disturbed_cost = 0.0, 0.0, 0.0
    xhat, tracks = x + 0.99 * r * rng.choice([-1, 1], x.shape), []
    for k in range(6):
        u, uhat = inc(plant.C @ x), inc(plant.C @ xhat)
        tracks.append((np.abs(xhat - x).max(axis=1), np.abs(uhat - u).max(axis=1), np.abs(xhat).max(axis=1),
                       np.abs(uhat).max(axis=1)))
        cost = cost + 0.9**k * (np.sum(x * (claim.Q @ x), axis=0) + np.sum(u * (claim.R @ u), axis=0))
        disturbed_cost = disturbed_cost + 0.9**k * (np.sum(xhat * (claim.Q @ xhat), axis=0)
                                                    + np.sum(uhat * (claim.R @ uhat), axis=0))
        size = max(size, np.abs(xhat).max(), np.abs(uhat).max())
        x, xhat = plant.A @ x + plant.B @ u, plant.A @ xhat + plant.B @ uhat + 0.99 * r * rng.choice([-1, 1], x.shape)
    measured = [quiet(track[2], track[3]) for track in tracks]
    found = enclose(loop, claim, terminal, measured, ends(), 1e-9)
    assert found.rounding >= r
    for k, (error, input_error, _, _) in enumerate(tracks):
        assert np.all(error <= found.state[k]) and np.all(input_error <= found.inputs[k])
    assert np.max(np.abs(cost - disturbed_cost)) <= found.cost
    assert found.state[1].max() < 100 * np.max(tracks[1][0])  # a bound, not a platitude


@pytest.mark.parametrize("seed", range(4))
def test_a_law_prolonged_beyond_its_piece_is_as_wrong_as_the_bound_allows(seed):
    plant, inc, claim, loop, terminal = setting(seed)
    rng = np.random.default_rng(seed)
    x = rng.uniform(-2, 2, (300, N))
    near = x + 0.3 * rng.standard_normal(x.shape)
    patterns = loop.patterns_at(x)
    distinct, which = loop.distinct(patterns)
    laws = loop.laws(distinct)
    z = (laws.Zx[which] @ near[:, :, None])[:, :, 0] + laws.z0[which]
    beyond = np.maximum(np.maximum(laws.low[which] - z, z - laws.high[which]), 0).max(axis=1)
    u = (laws.Gx[which] @ near[:, :, None])[:, :, 0] + laws.g[which]
    wrong = np.abs(u - inc(plant.C @ near.T).T)
    used = beyond > 1e-6
    assert used.sum() > 20 and wrong[used].max() > 1e-4
    for t, gap in zip(beyond[used], wrong[used], strict=True):
        found = enclose(loop, claim, terminal, [quiet(np.ones(N), np.ones(M), beyond=float(t))], ends())
        assert np.all(gap <= found.inputs[0])


def test_rounds_of_cutting_and_pieces_enter():
    _, _, claim, loop, terminal = setting(0)
    one = enclose(loop, claim, terminal, [quiet(np.ones(N), np.ones(M))], ends(), 1e-9)
    cut = enclose(loop, claim, terminal, [quiet(np.ones(N), np.ones(M), rounds=5)], ends(), 1e-9)
    many = enclose(loop, claim, terminal, [quiet(np.ones(N), np.ones(M))], ends(1000), 1e-9)
    assert np.all(cut.state[1] >= one.state[1] + 0 * cut.state[1]) and cut.inputs.max() > 2 * one.inputs.max()
    assert many.cost >= one.cost + 998 * 2 * one.rounding


@pytest.mark.parametrize("seed", range(3))
def test_the_rounded_walk_agrees_with_the_exact_one_within_its_bound(seed):
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    rng = np.random.default_rng(seed)
    claim = Regional(Box([-0.4, -0.3], [0.5, 0.3]), Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98)
    gain = np.array([[-1.37, -2.65]]) * (1 + 0.1 * rng.random())
    loop, fixed = (PiecewiseLoop(plant, INC.saturated(gain, 1.0), kind) for kind in ("exact", "fixed"))
    floats, why = find(PiecewiseLoop(plant, loop.inc), claim)
    assert floats is not None, why
    exact_set = in_fractions(loop, claim, floats)
    true, found = walk(loop, claim, exact_set), walk(fixed, claim, in_places(exact_set, 1 - 2.0**-40))
    errors = enclose(fixed, claim, in_places(exact_set, 1.0), found.steps, Arrival.of(found.done))
    assert errors.arrives(exact_set) and errors.cost < 1e-60
    gap = abs(float(found.done.expected_cost().fraction() - true.done.expected_cost()))
    assert 0 < gap <= errors.cost or len(found.done) != len(true.done)
    worst = abs(float(found.done.worst_cost()[0].fraction() - true.done.worst_cost()[0]))
    assert worst <= errors.cost or len(found.done) != len(true.done)


def test_arrival_and_limits_refuse_errors_that_are_too_large():
    _, _, _, _, terminal = setting(0)
    small = Enclosure(np.full((2, N), 1e-40), np.full((1, M), 1e-40), 0.0, 1e-60)
    assert small.arrives(terminal)
    assert not replace(small, state=np.full((2, N), 1e-10)).arrives(terminal)
    limited = Regional(Box(-np.ones(N), np.ones(N)), Box(-np.ones(M), np.ones(M)), np.eye(N), np.eye(M), 0.9)
    steps = [Step(0, 0.0, np.ones(N), np.ones(M), 1e-30, 1.0, 1)]
    assert small.keeps_limits(limited, steps)
    assert not small.keeps_limits(limited, [replace(steps[0], slack=0.0)])
    assert not small.keeps_limits(limited, [replace(steps[0], slack=9e-41)])


def test_a_contraction_too_slow_for_the_bound_is_given_up():
    plant, inc = Plant([[0.5]], [[1.0]]), INC([[1 - 1e-7]], [[0.1]], [[0.0]], [[0.0]], b=[1.0])
    loop = PiecewiseLoop(plant, inc)
    claim = Regional(Box([-1.0], [1.0]), None, [[1.0]], [[1.0]], 0.9)
    terminal, why = find(PiecewiseLoop(plant, inc.without_idle_units()), claim)
    assert terminal is not None, why
    assert enclose(loop, claim, terminal, [quiet(np.ones(1), np.ones(1))], ends(n=1)).cost == np.inf


def test_proofs_say_by_which_means():
    plant = Plant([[1.5]], [[1.0]])
    claim = Regional(Box([-1.0], [1.0]), Box([-1.0], [1.0]), [[1.0]], [[0.0]], 0.9)
    built_in = certify_region(plant, INC.saturated([[-1.5]], 1.0), claim).prove()
    assert built_in and "256 binary places" in built_in.method
    touching = certify_region(plant, INC.linear([[-1.0]]), claim).prove()
    assert touching and touching.method == "exact fractions over all pieces"


def test_a_linear_scalar_loop_by_hand():
    """x+ = 0.5 x + 0.01 u, u = 40 x: an error r grows to 0.9 r + r, a cost at x = 3 changes by 2 3 r, or 2 120 40 r."""
    plant, inc = Plant([[0.5]], [[0.01]]), INC.linear([[40.0]])
    for Q, R, least in (([[1.0]], [[0.0]], 2 * 3 * 1.0), ([[0.0]], [[1.0]], 2 * 120 * 40.0)):
        claim = Regional(Box([-3.0], [3.0]), None, Q, R, 0.9)
        loop = PiecewiseLoop(plant, inc)
        terminal, why = find(loop, claim)
        assert terminal is not None, why
        still = replace(terminal, tail=0 * terminal.tail)
        found = enclose(loop, claim, still, [quiet(np.array([3.0]), np.array([120.0]))], ends(0, 1), 1e-60)
        r = found.rounding
        assert 1.89 * r <= found.state[1][0] <= 1.92 * r
        assert least * r <= found.cost <= 1.1 * (least + 30) * r
        longer = enclose(loop, claim, still, [quiet(np.array([30.0]), np.array([1200.0]))], ends(0, 1), 1e-60)
        assert longer.cost / longer.rounding >= 5 * least


def test_the_tail_counts_with_where_the_pieces_arrive():
    """Arriving at |x| = 50 with a tail cost 2 x^2, an error r changes the cost by 200 r."""
    plant, inc = Plant([[0.5]], [[1.0]]), INC.linear([[0.0]])
    claim = Regional(Box([-3.0], [3.0]), None, [[1.0]], [[1.0]], 0.9)
    loop = PiecewiseLoop(plant, inc)
    terminal, why = find(loop, claim)
    assert terminal is not None, why
    far = replace(terminal, tail=np.diag([2.0, 0.0]))
    costs = [enclose(loop, claim, far, [quiet(np.ones(1), np.ones(1))], Arrival(1, np.array([x]), 1.0), 1e-60)
             for x in (1.0, 50.0)]
    assert costs[1].cost - costs[0].cost >= 190 * costs[1].rounding * 1.5


def posed_setting(seed):
    inc = posed.mpc_law(horizon=3 + seed % 2, step=0.1)
    claim = Regional(Box(-0.8 * np.ones(2), 0.8 * np.ones(2)), None, np.eye(2), [[0.05]], 0.98)
    loop = PiecewiseLoop(posed.PLANT, inc)
    terminal, why = find(loop, claim)
    assert terminal is not None and not inc.well_posedness().contracts, why
    return posed.PLANT, inc, claim, loop, terminal


@pytest.mark.parametrize("seed", range(2))
def test_under_a_multiplier_input_errors_stay_within_the_bound(seed):
    """Both sources of error at one step: a state off by r, and a law prolonged beyond its piece."""
    plant, inc, claim, loop, terminal = posed_setting(seed)
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (2, 400))
    off = x + 1e-4 * rng.choice([-1, 1], x.shape)
    found = enclose(loop, claim, terminal, [quiet(np.ones(2), np.ones(1))], ends(n=2), 1e-9)
    scaled = enclose(loop, claim, terminal, [quiet(np.ones(2), np.ones(1))], ends(n=2), 1e-9 * 1e-4 / found.rounding)
    assert scaled.rounding == pytest.approx(1e-4)
    assert np.all(np.abs(inc(off) - inc(x)).max(axis=1) <= scaled.inputs[0] * (1 + 1e-6))
    patterns = loop.patterns_at(x.T)
    distinct, which = loop.distinct(patterns)
    laws = loop.laws(distinct)
    near = x.T + 0.2 * rng.standard_normal(x.T.shape)
    z = (laws.Zx[which] @ near[:, :, None])[:, :, 0] + laws.z0[which]
    beyond = np.maximum(np.maximum(laws.low[which] - z, z - laws.high[which]), 0).max(axis=1)
    wrong = np.abs((laws.Gx[which] @ near[:, :, None])[:, :, 0] + laws.g[which] - inc(near.T).T)
    used = beyond > 1e-6
    assert used.sum() > 20 and wrong[used].max() > 1e-4
    for t, gap in zip(beyond[used], wrong[used], strict=True):
        steps = [quiet(np.ones(2), np.ones(1), beyond=float(t))]
        assert np.all(gap <= enclose(loop, claim, terminal, steps, ends(n=2)).inputs[0])
