"""On random small loops, exact costs, reachable sets and admissibility agree with dense sampling, never exceeded by it."""

from dataclasses import replace

import numpy as np
import pytest
from small_loops import SmallLoop, small_loop
from walk_draws import USABLE, draw

from inc_casadi import Box, Polytope
from inc_casadi.claims.invariance import Invariance
from inc_casadi.invariance_certificate import certify_invariance
from inc_casadi.loop import equilibrium
from inc_casadi.pieces.reach import reachable
from inc_casadi.regional_certificate import certify_region

SAMPLES, REACH = 250, 4
MANY, DENSE = 40, 2000  # seeds of each kind and samples of the slow version
FEW = [*(("drawn", seed) for seed in USABLE[:2]), *(("mixed", seed) for seed in range(4)),
       *(("net", seed) for seed in (0, 3, 4)), *(("saturated", seed) for seed in range(3)),
       *(("posed", seed) for seed in (1, 2, 3)), ("mpc", 0), *(("ties", seed) for seed in (0, 1, 2))]
MORE = [*(("drawn", seed) for seed in USABLE[2:5]), *(("mixed", seed) for seed in range(4, 12)),
        *(("net", seed) for seed in (1, 5, 6, 8)), *(("saturated", seed) for seed in range(3, 7)),
        *(("posed", seed) for seed in (5, 7, 9)), ("mpc", 1), *(("ties", seed) for seed in (4, 5, 7))]
EACH = pytest.mark.parametrize(("kind", "seed"), [*FEW, *(pytest.param(*case, marks=pytest.mark.slow) for case in MORE)])


def loop_of(kind, seed):
    return SmallLoop(*draw(seed)) if kind == "drawn" else small_loop(kind, seed)


def drawn(loop, seed, count):
    """Starting points: uniform ones, and the corners of the set."""
    rng = np.random.default_rng([seed, 1])
    return loop.claim.initial.sample(count, rng), loop.claim.initial.support.vertices


def check_costs(loop, certificate, seed, count=SAMPLES):
    """The mean within four standard errors, no sample above the worst cost, which is attained; forms and inputs agree.

    The room that inputs leave is attained at vertices of the cells and never undercut. Returns the least room over all
    steps: within the terminal set inputs are affine in x0 too, so that vertices attain it there as well.
    """
    limits, cells = loop.claim.inputs, certificate.walk.arrived
    taken = certificate.walk.steps_taken
    steps = max(loop.steps, 2 * int(taken.max(initial=0)) + 30)
    (points, corners), (worst, at), rest = drawn(loop, seed, count), certificate.worst, equilibrium(loop.plant, loop.inc).x
    x, u, costs = loop.costs(np.hstack([points, corners, at[:, None], cells.start.T]), steps)
    assert ellipsoid(certificate, cells.now.T, rest) <= certificate.level, "a cell counts as arrived too early"
    last = ellipsoid(certificate, x[:, :, -1], rest)
    assert last <= 0.99 * certificate.level, "the motions do not converge"
    mean, error = costs[:count].mean(), costs[:count].std() / np.sqrt(count)
    assert abs(mean - certificate.expected) < 4 * error + 1e-9 * certificate.expected
    assert costs.max() <= worst * (1 + 1e-8)
    assert costs[count + corners.shape[1]] == pytest.approx(worst, rel=1e-7)
    rows, columns = located(cells, points)
    np.testing.assert_allclose(forms_at(cells, points[:, columns], rows), costs[columns], rtol=1e-6, atol=1e-9 * worst)
    room = limits.h[:, None, None] - np.einsum("km,mnt->knt", limits.H, u)
    # The walk looks at inputs until a cell arrives; from there on the terminal set keeps the limits.
    k = np.arange(steps + 1)
    sampled = room[:, columns].min(axis=0)[k < taken[rows][:, None]]
    attained = room[:, -len(cells.owner):].min(axis=0)[k < taken[cells.owner][:, None]]
    assert certificate.walk.slack <= sampled.min(initial=np.inf) + 1e-9
    assert attained.min(initial=np.inf) <= certificate.walk.slack + 1e-9
    return room.min()


def ellipsoid(certificate, x, rest):
    """The largest e'P e over columns x (n, N), e = x - x*."""
    e = x - rest[:, None]
    return float(np.max(np.sum(e * (certificate.P @ e), axis=0)))


def forms_at(cells, points, rows):
    """The cost that the form of its cell (N,) states from each point (n, N)."""
    lifted = np.vstack([points - cells.center[rows].T, np.ones(points.shape[1])])
    return np.einsum("in,nij,jn->n", lifted, cells.cost[rows], lifted)


def located(cells, points):
    """Pairs (cell, point) of every point and the cells whose half-spaces hold it, up to rounding; none may be lost."""
    rows, columns = [], []
    for i in range(len(cells)):
        facets = np.unique(cells.facets[cells.owner == i])
        planes = cells.planes[facets // 2] * np.where(facets % 2 == 0, 1.0, -1.0)[:, None]
        size = np.abs(planes).sum(axis=1)[:, None] * max(1.0, np.abs(points).max())
        inside = np.flatnonzero(np.all(planes[:, :-1] @ points - planes[:, -1:] <= 1e-11 * size, axis=0))
        rows.append(np.full(len(inside), i))
        columns.append(inside)
    together = np.concatenate(columns)
    assert set(together) == set(range(points.shape[1])), "a starting point lies in no cell"
    return np.concatenate(rows), together


def check_limits(loop, room):
    """Limits moved in by the room that is left decide admissibility: a little less holds, a little more does not."""
    limits = loop.claim.inputs
    for share, holds in ((1 - 1e-7, True), (1 + 1e-7, False)):
        near = replace(loop.claim, inputs=Polytope(limits.H, limits.h - share * room))
        again = certify_region(loop.plant, loop.inc, near)
        assert again.holds() == (holds or again._built_in), again.reason
        assert holds or again._built_in or "limit" in again.reason


def check_reach(loop, seed, count=SAMPLES):
    """Samples lie where their starting cell's map sends them and within the boxes, which vertices attain; inputs alike."""
    sets = reachable(loop.plant, loop.inc, loop.claim.initial, REACH)
    assert not sets.ended and sets.steps == REACH
    points = np.hstack(drawn(loop, seed, count))
    x, u = loop.motions(points, REACH)
    region = loop.claim.initial.support
    for k in range(REACH + 1):
        cells, (low, high) = sets.stages[k], sets.boxes[k][:, :, None]
        room = 1e-9 * (1 + np.abs(sets.boxes[k]).max())
        assert np.all(x[:, :, k] >= low - room) and np.all(x[:, :, k] <= high + room)
        rows, columns = located(cells, points)
        lifted = np.vstack([points[:, columns] - cells.center[rows].T, np.ones(len(columns))])
        np.testing.assert_allclose(np.einsum("nij,jn->in", cells.motion[rows], lifted), x[:, columns, k], atol=room)
        reached, _ = loop.motions(cells.start.T, k)
        np.testing.assert_allclose(reached[:, :, k], cells.now.T, atol=room)
        planes = cells.planes[cells.facets // 2]
        beside = (planes[:, :, :-1] * cells.start[:, None, :]).sum(axis=2) - planes[:, :, -1]
        assert np.max(np.abs(beside) / np.abs(planes).sum(axis=2)) < 1e-10, "a vertex does not lie on its facets"
        assert sum(hull_volume(origin) for origin in sets.origins(k)) == pytest.approx(region.volume, rel=1e-8)
        if k < REACH:
            check_inputs(loop, sets, k, u[:, :, k])
        direction = np.random.default_rng([seed, k]).standard_normal(loop.plant.n)
        assert np.max(direction @ x[:, :, k]) <= sets.support(direction, k) + 10 * room


def check_inputs(loop, sets, k, sampled):
    """The extremes of u_k hold every sample, and starting points of the next step's vertices attain them."""
    lowest, highest = sets.inputs[k]
    _, u = loop.motions(sets.stages[k + 1].start.T, k)
    u = u[:, :, k]
    room = 1e-9 * (1 + np.abs(u).max())
    np.testing.assert_allclose(u.min(axis=1), lowest, atol=room)
    np.testing.assert_allclose(u.max(axis=1), highest, atol=room)
    assert np.all(sampled.min(axis=1) >= lowest - room) and np.all(sampled.max(axis=1) <= highest + room)


def hull_volume(points):
    """The volume of a convex hull, by an interval or by Qhull in joggled coordinates, as slivers need them."""
    if points.shape[1] == 1:
        return float(np.ptp(points))
    from scipy.spatial import ConvexHull
    return ConvexHull(points, qhull_options="QJ").volume


def check_invariance(loop, seed, count=SAMPLES):
    """eq:regional_input_check by pieces: every slack is attained, none is undercut, and verdicts turn where it is 0."""
    region = loop.claim.initial.support
    points = np.hstack(drawn(loop, seed, count))
    task = Invariance(region, loop.claim.inputs)
    certificate = certify_invariance(loop.plant, loop.inc, task, "pieces")
    slacks = certificate.slacks
    assert slacks is not None and not slacks.ended
    sampled, reached = slack_rows(loop, task, points), slack_rows(loop, task, slacks.points.T)
    room = 1e-9 * (1 + np.abs(sampled).max())
    free = certificate._evidence.built_in < 0
    assert np.all(slacks.least[free] <= sampled.min(axis=1)[free] + room)
    np.testing.assert_allclose(np.diag(reached), slacks.reached, atol=room)
    np.testing.assert_allclose(slacks.least[free], slacks.reached[free], atol=room)
    assert certificate.holds() == bool(np.all(slacks.least > -room))
    if not certificate.holds():
        row, point, excess = certificate.counterexample
        assert region.contains(point, 1e-9) and -slack_rows(loop, task, point[:, None])[row, 0] >= excess - room > -room
    limits, least = loop.claim.inputs, slacks.reached[:task.limits]
    for share in (1 - 1e-6, 1 + 1e-6):
        near = Invariance(region, Polytope(limits.H, limits.h - share * least.min()))
        again = certify_invariance(loop.plant, loop.inc, near, "pieces")
        inputs = again.slacks.least[:task.limits]
        assert (inputs.min() >= 0) == (share < 1) or np.any(~free[:task.limits])


def slack_rows(loop, task, points):
    """h - H u and h - H x+ at columns (n, N), typed again: (k, N)."""
    u = loop.control(points)
    after = loop.plant.A @ points + loop.plant.B @ u
    region, limits = task.region, task.inputs
    if isinstance(region, Box):
        return np.vstack([limits.h[:, None] - limits.H @ u, _in_order(region, after)])
    return np.vstack([limits.h[:, None] - limits.H @ u, region.h[:, None] - region.H @ after])


def _in_order(box, x):
    """The slacks of a box in the order of its own half-spaces."""
    slack = {(i, 1.0): box.upper[i] - x[i] for i in range(box.dimension)}
    slack |= {(i, -1.0): x[i] - box.lower[i] for i in range(box.dimension)}
    return np.array([slack[int(np.flatnonzero(row)[0]), float(row.sum())] for row in box.H])


@EACH
def test_costs_and_admissibility_agree_with_sampling(kind, seed):
    loop = loop_of(kind, seed)
    certificate = certify_region(loop.plant, loop.inc, loop.claim).require()
    check_limits(loop, check_costs(loop, certificate, seed))


@EACH
def test_reachable_sets_agree_with_sampling(kind, seed):
    check_reach(loop_of(kind, seed), seed)


@EACH
def test_invariance_agrees_with_sampling(kind, seed):
    check_invariance(loop_of(kind, seed), seed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mixed", "net", "saturated", "posed", "mpc", "ties"])
def test_hundreds_of_loops_agree_with_dense_sampling(kind):
    certified = 0
    for seed in range(100, 100 + MANY):
        loop = loop_of(kind, seed)
        check_reach(loop, seed, DENSE)
        check_invariance(loop, seed, DENSE)
        certificate = certify_region(loop.plant, loop.inc, loop.claim)
        if certificate.holds():
            certified += 1
            check_limits(loop, check_costs(loop, certificate, seed, DENSE))
        else:  # a random law may leave its equilibrium unstable, or have none that Newton's method finds
            reasons = ("does not stabilize", "the walk ended", "no equilibrium")
            assert any(reason in certificate.reason for reason in reasons), certificate.reason
    assert certified > 0.7 * MANY
