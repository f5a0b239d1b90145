"""Error bounds cell by cell, against motions that are really disturbed, laws really prolonged and inverses in Fractions."""

from dataclasses import replace

import numpy as np
import oracles
import posed
import pytest
from small_loops import small_loop

from inc_casadi import INC, LeakyReLU, Plant, ReLU, Saturation
from inc_casadi.blocks import exact
from inc_casadi.pieces.cell_errors import _by_slopes, _kink_slopes, departures, next_errors, slopes_of
from inc_casadi.pieces.cell_motions import placed_laws
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.linear import solve

N, M, P, Q = 3, 2, 2, 5


def loop_of(seed):
    rng = np.random.default_rng(seed)
    plant = Plant(0.5 * rng.standard_normal((N, N)), rng.standard_normal((N, M)), rng.standard_normal((P, N)))
    W = rng.standard_normal((Q, Q))
    W *= 0.6 / np.abs(W).sum(axis=1, keepdims=True)
    units = (ReLU(), LeakyReLU(0.3), Saturation(), ReLU(), Saturation())
    return PiecewiseLoop(plant, INC(W, rng.standard_normal((Q, P)), rng.standard_normal((M, Q)),
                                    0.3 * rng.standard_normal((M, P)), rng.standard_normal(Q), activation=units))


def net(seed, widths=(2, 6, 5, 1)):
    rng = np.random.default_rng(seed)
    layers = [(rng.standard_normal((b, a)), rng.standard_normal(b)) for a, b in zip(widths, widths[1:], strict=False)]
    return PiecewiseLoop(Plant([[1.0, 0.4], [0.0, 0.9]], [[0.1], [0.3]]), INC.from_layers(layers, ReLU()))


def known(loop, patterns):
    """The slopes of patterns and the same laws in floats."""
    return slopes_of(loop, placed_laws(replace(loop, arithmetic="fixed"), patterns), patterns), loop.laws(patterns)


def exact_slopes(loop, pattern):
    """|Z|, |G|, |A + B G|, |W R|, |V R|, |B V R| in Fractions."""
    inc, plant, units = loop.inc, loop.plant, np.arange(loop.inc.q)
    W, U, V, K, A, B, C = (exact(part) for part in (inc.W, inc.U, inc.V, inc.K, plant.A, plant.B, plant.C))
    D = exact(loop.pieces_in_floats[0][units, pattern])
    R = solve(exact(np.eye(inc.q)) - D[:, None] * W, exact(np.eye(inc.q)))
    eta = R @ (D[:, None] * (U @ C))
    G = K @ C + V @ eta
    return [np.abs(part) for part in (W @ eta + U @ C, G, A + B @ G, W @ R, V @ R, B @ (V @ R))]


@pytest.mark.parametrize("loop", [*(loop_of(seed) for seed in range(4)), net(0), net(1)])
def test_slopes_are_bounded_from_above_and_closely(loop):
    rng = np.random.default_rng(0)
    patterns = loop.distinct(loop.patterns_at(2 * rng.standard_normal((40, loop.plant.n))))[0][:8]
    slopes, _ = known(loop, patterns)
    assert len(patterns) > 5 and slopes.known.all()
    for k, pattern in enumerate(patterns):
        bounds = (slopes.z, slopes.u, slopes.x, slopes.kink_z, slopes.kink_u, slopes.kink_x)
        for bound, true in zip(bounds, exact_slopes(loop, pattern), strict=True):
            assert np.all(true <= exact(bound[k]))
            assert np.all(bound[k] <= 1.00001 * true.astype(float) + 1e-9)
        for i, unit in enumerate(loop.inc.activations):
            largest = np.max(np.abs(unit.pieces.slopes - unit.pieces.slopes[pattern[i]]))
            assert largest <= slopes.change[k, i] <= 1.00001 * largest


@pytest.mark.parametrize("gap", [1e-9, 1e-12])
def test_an_inverse_that_floats_hardly_find_is_still_bounded(gap):
    rng = np.random.default_rng(1)
    W = rng.uniform(0.1, 1.0, (4, 4))
    W *= (1 - gap) / W.sum(axis=1, keepdims=True)
    loop = PiecewiseLoop(Plant(0.5 * np.eye(2), [[1.0], [0.0]]), INC(W, np.ones((4, 2)), np.ones((1, 4)), [[0.0, 0.0]]))
    bounds, sure = _kink_slopes(loop, np.ones((1, 4)))
    true = exact_slopes(loop, np.ones(4, dtype=int))
    assert sure[0] and np.all(np.concatenate(true[3:5]) <= exact(bounds[0, :5]))
    assert np.all(bounds[0, :5] <= 3 * np.concatenate(true[3:5]).astype(float))


def test_an_inverse_that_floats_do_not_find_is_not_claimed():
    loop = PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC([[1.0]], [[1.0]], [[1.0]], [[0.0]]))
    bounds, sure = _kink_slopes(loop, np.array([[1.0], [0.0]]))
    assert not sure[0] and not bounds[0].any()
    near = PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC([[0.7, 0.3], [0.3, 0.7]], np.ones((2, 1)), [[1.0, 1.0]], [[0.0]]))
    assert not _kink_slopes(near, np.ones((1, 2)))[1][0]


@pytest.mark.parametrize("seed", range(6))
def test_departures_are_the_least_that_bound_themselves(seed):
    rng = np.random.default_rng(seed)
    k, q = 30, 5
    through, change = rng.random((q, q)), rng.random(q) * (rng.random(q) < 0.8)
    through *= rng.choice([0.5, 0.9]) / np.max(np.abs(np.linalg.eigvals(change[:, None] * through)))
    beyond, reach = rng.normal(-0.5, 1.0, (k, q)), 0.3 * rng.random((k, q))
    d, confirmed = departures(beyond, reach, through, change)
    least = np.zeros((k, q))
    for _ in range(2000):
        least = change * np.maximum(beyond + reach + least @ through.T, 0)
    assert confirmed.all() and np.all(d >= least) and np.all(d <= 1.001 * least + 1e-3)
    assert np.all(change * np.maximum(beyond + reach + d @ through.T, 0) <= d) and (least == 0).any() and (least > 0).any()


def test_departures_that_grow_are_not_confirmed_and_do_not_overflow():
    d, confirmed = departures(np.array([[-1.0, -1.0], [0.0, 0.0]]), np.full((2, 2), 1e-60), 3 * np.ones((2, 2)), np.ones(2))
    assert confirmed.tolist() == [True, False] and np.all(d[0] == 0) and np.all(np.isfinite(d))


def test_departures_of_a_far_unit_begin_exactly_at_its_margin():
    """A unit whose margin is used up by less than a rounding of it counts, one with as much room left does not."""
    for margin, counts in ((1e-9, True), (1e-9 * (1 + 4e-6), False)):
        d, confirmed = departures(np.array([[-margin]]), np.array([[1e-9]]), np.zeros((1, 1)), np.ones(1))
        assert confirmed.all() and (d[0, 0] > 0) == counts


def disturbed(loop, rng, count, near, size):
    """Points, patterns that are right nearby, how far these are beyond their pieces, and the true states around."""
    x = 2 * rng.standard_normal((count, loop.plant.n))
    patterns = loop.patterns_at(x + near * rng.standard_normal(x.shape))
    distinct, which = loop.distinct(patterns)
    slopes, laws = known(loop, distinct)
    z = (laws.Zx[which] @ x[:, :, None])[:, :, 0] + laws.z0[which]
    beyond = np.maximum(laws.low[which] - z, z - laws.high[which])
    E = size * rng.uniform(0.2, 1.0, x.shape)
    said = (laws.Gx[which] @ x[:, :, None])[:, :, 0] + laws.g[which]
    return x, E, which, slopes, beyond, said


@pytest.mark.parametrize(("near", "size"), [(0.1, 1e-2), (0.0, 1e-2), (0.3, 1e-7), (1e-4, 1e-3)])
@pytest.mark.parametrize("which_loop", range(7))
def test_a_law_prolonged_and_a_state_disturbed_answer_within_the_bound(which_loop, near, size):
    loop = (loop_of(which_loop) if which_loop < 4 else net(which_loop) if which_loop < 6
            else PiecewiseLoop(posed.PLANT, posed.mpc_law(horizon=4, step=0.1)))
    rng = np.random.default_rng(which_loop)
    x, E, which, slopes, beyond, said = disturbed(loop, rng, 120, near, size)
    r = 1e-3 * size
    answers = next_errors(loop, loop.inc.well_posedness(), slopes, which, E, beyond - r, r)
    control = oracles.control if loop.inc.well_posedness().contracts else small_control
    A, B = loop.plant.A, loop.plant.B
    most = np.zeros(2)
    for _ in range(12):
        true = x + E * rng.choice([-1.0, 1.0], E.shape)
        u = control(loop.inc, loop.plant.C @ true.T).T
        wrong = np.abs(u - said), np.abs(true @ A.T + u @ B.T - x @ A.T - said @ B.T)
        for i, (gap, bound) in enumerate(zip(wrong, answers[::-1], strict=True)):
            assert np.all(gap <= bound + 1e-13)
            most[i] = max(most[i], np.max(gap / bound))
    assert near > 0.2 or np.all(most > 0.02)  # a bound, not a platitude


def small_control(inc, y):
    from small_loops import by_patterns
    return by_patterns(inc, y)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_far_from_kinks_answers_by_its_own_law_only(seed):
    """The bound is |G| E and |A + B G| E there, to a millionth, plus r: nothing of the slopes of other pieces."""
    loop = loop_of(seed)
    x, E, which, slopes, beyond, _ = disturbed(loop, np.random.default_rng(seed), 200, 0.0, 1e-9)
    far = (beyond < -1e-3).all(axis=1)
    after, inputs = next_errors(loop, loop.inc.well_posedness(), slopes, which[far], E[far], beyond[far], 1e-12)
    G = loop.laws(loop.distinct(loop.patterns_at(x))[0]).Gx[which[far]]
    law = loop.plant.A + loop.plant.B @ G
    assert far.sum() > 20
    for found, matrix in ((inputs, G), (after, law)):
        np.testing.assert_allclose(found, (np.abs(matrix) @ E[far][:, :, None])[:, :, 0] + 1e-12, rtol=1e-5)
    worse = _by_slopes(loop, loop.inc.well_posedness(), E[far].max(axis=0), 0.0, 1e-12)
    assert np.all(worse[0] > 2 * np.median(after, axis=0))


@pytest.mark.parametrize("seed", range(3))
def test_cells_whose_kinks_answer_each_other_take_the_bound_from_slopes(seed):
    loop = PiecewiseLoop(posed.PLANT, posed.mpc_law(horizon=4, step=0.1))
    x, E, which, slopes, beyond, said = disturbed(loop, np.random.default_rng(seed), 40, 0.3, 1e-3)
    unknown = replace(slopes, known=np.zeros(len(slopes.known), dtype=bool))
    test = loop.inc.well_posedness()
    after, inputs = next_errors(loop, test, unknown, which, E, beyond, 1e-9)
    worst = _by_slopes(loop, test, E.max(axis=0), float(beyond.max()), 1e-9)
    np.testing.assert_array_equal(after, np.broadcast_to(worst[0], after.shape))
    np.testing.assert_array_equal(inputs, np.broadcast_to(worst[1], inputs.shape))
    true = x + E * np.random.default_rng(9).choice([-1.0, 1.0], E.shape)
    u = small_control(loop.inc, true.T).T
    assert np.all(np.abs(u - said) <= inputs)
    A, B = loop.plant.A, loop.plant.B
    assert np.all(np.abs(true @ A.T + u @ B.T - x @ A.T - said @ B.T) <= after)


def test_slopes_that_bound_nothing_give_infinity():
    loop = PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC([[1 - 1e-7]], [[0.1]], [[1.0]], [[0.0]], b=[1.0]))
    after, error = _by_slopes(loop, loop.inc.well_posedness(), np.ones(1), 0.0, 1e-9)
    assert np.isinf(after).all() and np.isinf(error).all()


@pytest.mark.parametrize("kind", ["mixed", "net", "saturated", "ties"])
def test_slopes_of_chosen_rows_are_rows_of_all(kind):
    loop = PiecewiseLoop(*(getattr(small_loop(kind, 0), name) for name in ("plant", "inc")))
    patterns = loop.distinct(loop.patterns_at(np.random.default_rng(0).uniform(-1, 1, (50, loop.plant.n))))[0]
    laws = placed_laws(replace(loop, arithmetic="fixed"), patterns)
    every, some = slopes_of(loop, laws, patterns), slopes_of(loop, laws, patterns, np.array([1, 0]))
    for name in ("z", "u", "x", "kink_z", "kink_u", "kink_x", "change", "known"):
        np.testing.assert_array_equal(getattr(some, name), getattr(every, name)[[1, 0]])


def test_the_bound_from_slopes_by_hand():
    """x+ = 3 x + 5 u and u = 7 x + 2 relu(x): an error 1 gives 7 + 2, one beyond the piece by 0.5 gives 2 * 2 * 0.5 more."""
    loop = PiecewiseLoop(Plant([[3.0]], [[5.0]]), INC([[0.0]], [[1.0]], [[2.0]], [[7.0]]))
    test = loop.inc.well_posedness()
    for beyond, r, error in ((0.0, 1e-12, 9.0), (0.5, 1e-12, 11.0), (0.0, 0.25, 9.0 + 2 * 2 * 0.25 + 0.25)):
        after, found = _by_slopes(loop, test, np.ones(1), beyond, r)
        assert found[0] == pytest.approx(error, rel=1e-5) and after[0] == pytest.approx(3 + 5 * error + r, rel=1e-5)
