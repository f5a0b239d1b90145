"""What following a walk with 256 places says, against true motions in Fractions and exact integrals; and its verdicts."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from settled_walks import SHARE, clipped, walked
from small_loops import small_loop
from walk_draws import draw

from inc_casadi import INC, Box, Plant, Saturation
from inc_casadi.blocks import exact
from inc_casadi.claims.regional import Regional
from inc_casadi.pieces.cell_enclosure import _arrival, enclose_cells
from inc_casadi.pieces.cell_motions import motions, placed_laws, planes
from inc_casadi.pieces.cell_proof import _tails, settle
from inc_casadi.pieces.cell_steps import Passages
from inc_casadi.pieces.cell_vertices import refined
from inc_casadi.pieces.cell_walk import cell_walk
from inc_casadi.pieces.cells import simplices_of
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.terminal import find, in_places


def settled_parts(case, monkeypatch):
    """What `settle` came to, with the walk and the steps that it handed to the error bound."""
    seen = []

    def recorded(loop, claim, terminal, passages, start, deadline):
        seen.append(passages)
        return enclose_cells(loop, claim, terminal, passages, start, deadline)

    monkeypatch.setattr("inc_casadi.pieces.cell_proof.enclose_cells", recorded)
    found, loop, terminal = walked(*case)
    settled = settle(found, loop, case[2], in_places(terminal, SHARE))
    assert not isinstance(settled, str), settled
    return found, loop, terminal, settled, seen[0]


def along(loop, x0, steps):
    """The true motion of a point (n,) in Fractions: states and inputs, by the pattern that holds at each of them."""
    exactly = replace(loop, arithmetic="exact")
    A, B = exactly.numbers(loop.plant.A), exactly.numbers(loop.plant.B)
    x, u = [x0], []
    for _ in range(steps):
        law = exactly.laws(exactly.patterns_at(x[-1][None]))
        u.append(law.Gx[0] @ x[-1] + law.g[0])
        x.append(A @ x[-1] + B @ u[-1])
    return x, u


def fractions(array):
    return np.vectorize(lambda n: Fraction(int(n), 1 << 256), otypes=[object])(array)


def far():
    """A linear law from far away: nothing is cut, so all error is that of maps and forms over many steps."""
    plant = Plant([[0.77, 0.3], [-0.2, 0.81]], [[0.3], [0.7]])
    half = 3e8 * np.ones(2)
    return plant, INC.linear([[-0.1, -0.07]]), Regional(Box(-half, half), Box([-1e9], [1e9]), np.eye(2), [[0.3]], 0.97)


@pytest.mark.parametrize("case", [draw(1), draw(3), draw(8), clipped(), far()])
def test_the_true_motion_from_a_vertex_is_within_the_stated_error(case, monkeypatch):
    found, loop, terminal, settled, passages = settled_parts(case, monkeypatch)
    _, claim = case[1:]
    vertices, moved = vertices_of(case, found, loop)
    form = moved.cost[found.node]
    errors, reach = settled.enclosure, _arrival(in_places(terminal, SHARE), passages)[2]
    assert np.max(errors.state) < 1e-25 and 0 < errors.cost < 1e-20 * found.worst[0]
    assert np.min(errors.state[0]) >= vertices.error
    for v in range(0, len(found.arrived.owner), 5):
        cell, x0 = found.arrived.owner[v], fractions(vertices.points[v])
        steps = int(found.steps_taken[cell])
        x, u = along(loop, x0, steps)
        node = found.node[cell]
        for k in range(steps, -1, -1):
            said = fractions(moved.F[node]) @ x0 + fractions(moved.f[node])
            assert np.all(np.abs(said - x[k]) <= [Fraction(e) for e in errors.state[k]])
            assert k < steps or np.all(np.abs(said - x[k]) <= [Fraction(e) for e in errors.final[cell]])
            node = found.trails.parent[node]
        for k in range(steps):
            assert np.all(np.abs(x[k]).astype(float) <= settled.steps[k].x * (1 + 1e-12))
            assert np.all(np.abs(u[k]).astype(float) <= settled.steps[k].u * (1 + 1e-12))
            assert settled.steps[k].slack <= np.min(claim.inputs.h - claim.inputs.H @ u[k].astype(float)) + 1e-9
        assert np.all(np.abs(x[-1]).astype(float) <= reach[cell] * (1 + 1e-12))
        lifted = np.append(x0, Fraction(1))
        beta, Q, R = Fraction(claim.discount), exact(claim.Q), exact(claim.R)
        true = sum(beta**k * (x[k] @ Q @ x[k] + u[k] @ R @ u[k]) for k in range(steps))
        assert abs(lifted @ fractions(form[cell]) @ lifted - true) <= Fraction(errors.cost)


def vertices_of(case, found, loop):
    laws = placed_laws(loop, found.trails.patterns)
    moved = motions(loop, case[2], found.trails, laws)
    a, b = planes(found, case[2].initial.support, laws, moved, 128)
    return refined(found.arrived, a, b), moved


def test_the_expected_cost_is_rounded_up_by_more_than_all_rounding(monkeypatch):
    case = clipped()
    found, loop, terminal, settled, _ = settled_parts(case, monkeypatch)
    vertices, moved = vertices_of(case, found, loop)
    form = moved.cost[found.node] + _tails(found, case[2], in_places(terminal, SHARE), moved)
    corners, owner = simplices_of(found.arrived)
    total, whole = Fraction(0), Fraction(0)
    for simplex, cell in zip(corners, owner, strict=True):
        points = np.column_stack([fractions(vertices.points[simplex]), [Fraction(1)] * 3])
        d = points[1:, :2] - points[0, :2]
        volume = abs(d[0, 0] * d[1, 1] - d[0, 1] * d[1, 0])
        c, s = fractions(form[cell]), points.sum(axis=0)
        total += volume * (sum(p @ c @ p for p in points) + s @ c @ s) / 12
        whole += volume
    assert abs(whole - 2 * Fraction(case[2].initial.support.volume)) < Fraction(1, 10**12)
    assert 0 < settled.expected - total / whole < Fraction(1, 10**55)


def test_errors_of_the_vertices_are_where_the_error_bound_starts(monkeypatch):
    def blurred(*args):
        return replace(refined(*args), error=1e-60)

    monkeypatch.setattr("inc_casadi.pieces.cell_proof.refined", blurred)
    *_, settled, _ = settled_parts(clipped(), monkeypatch)
    assert np.all(settled.enclosure.state[0] >= 1e-60)


@pytest.mark.parametrize("seed", [1, 3, 8])
def test_arrival_is_decided_at_the_farthest_vertex(seed):
    plant, inc, claim = draw(seed)
    found, loop, terminal = walked(plant, inc, claim)
    e = found.arrived.now - terminal.x.astype(float)
    farthest = float(np.max(np.sum(e @ terminal.P.astype(float) * e, axis=1)) / float(terminal.level))
    for share, arrives in ((farthest * (1 + 1e-9), True), (farthest * (1 - 1e-9), False)):
        assert settle(found, loop, claim, in_places(terminal, share)).arrived == arrives


@pytest.mark.parametrize(("lower", "upper", "beyond"), [(-1.0, 2.5, 1.5), (-3.0, 1.0, 2.0), (-1.0, 1.0 + 1e-12, 1e-12),
                                                        (-0.5, 0.5, 0.0)])
def test_how_far_z_leaves_its_piece_is_found_on_both_sides(lower, upper, beyond, monkeypatch):
    """A walk that does not cut at all takes z = x for linear throughout: it leaves [-1, 1] by the ends of the interval."""
    monkeypatch.setattr("inc_casadi.pieces.cutting.TOLERANCE", 10.0)
    plant, inc = Plant([[0.5]], [[0.125]]), INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=Saturation())
    claim = Regional(Box([lower], [upper]), None, [[1.0]], [[1.0]], 0.9)
    found, loop, terminal = walked(plant, inc, claim)
    terminal = replace(terminal, level=terminal.level / 10**6)
    found = cell_walk(replace(loop, arithmetic="float"), claim, replace(find(replace(loop, arithmetic="float"), claim)[0],
                                                                        level=float(terminal.level)))
    assert len(found.arrived) == 1
    settled = settle(found, loop, claim, in_places(terminal, SHARE))
    assert settled.steps[0].beyond == pytest.approx(beyond, rel=1e-3, abs=1e-70)
    assert (settled.enclosure.cost < 1e-9) == (beyond < 1e-11)
    for x0 in (lower, upper):
        true = x0
        for _ in settled.steps:
            true = 0.5 * true + 0.125 * np.clip(true, -1, 1)
        assert abs(0.625 ** len(settled.steps) * x0 - true) <= settled.enclosure.final[0, 0] + 1e-15
    assert len(settled.steps) == found.steps_taken.max() > 3


def test_an_input_that_touches_its_limit_has_no_room_left():
    plant, inc, claim = clipped()
    found, loop, terminal = walked(plant, inc, claim)
    settled = settle(found, loop, claim, in_places(terminal, SHARE))
    assert abs(min(step.slack for step in settled.steps)) < 1e-60
    tight = replace(claim, inputs=Box([-1.0], [1.0 - 1e-13]))
    assert min(step.slack for step in settle(found, loop, tight, in_places(terminal, SHARE)).steps) < -0.99e-13


@pytest.mark.parametrize("seed", range(9))
def test_cells_are_settled_where_kinks_pass_through_corners_and_each_other(seed):
    loop = small_loop("ties", seed)
    found, places, terminal = walked(loop.plant, loop.inc.without_idle_units(), loop.claim)
    settled = settle(found, places, loop.claim, in_places(terminal, SHARE))
    assert not isinstance(settled, str), settled
    assert settled.arrived and settled.enclosure.arrives(in_places(terminal, SHARE))


@pytest.mark.parametrize(("kind", "seed"), [("posed", 111), ("mixed", 1), ("saturated", 1)])
def test_the_error_of_all_costs_covers_starting_points_that_are_off(kind, seed, monkeypatch):
    """Tail included: from the first of these sets every motion starts in the terminal set."""
    off = 1e-5
    monkeypatch.setattr("inc_casadi.pieces.cell_proof.refined", lambda *args: replace(refined(*args), error=off))
    monkeypatch.setattr("inc_casadi.pieces.cell_proof.trouble", lambda *_: "")
    small = small_loop(kind, seed)
    found, loop, terminal = walked(small.plant, small.inc.without_idle_units(), small.claim)
    settled = settle(found, loop, small.claim, in_places(terminal, SHARE))
    cells, rng = found.arrived, np.random.default_rng(seed)
    lifted = cells.lifted()
    said = np.einsum("vi,vij,vj->v", lifted, cells.cost[cells.owner], lifted)
    _, _, costs = small.costs(cells.start.T + off * rng.choice([-1.0, 1.0], cells.start.T.shape), small.steps)
    assert 1e-6 * np.max(said) < np.max(np.abs(costs - said)) <= settled.enclosure.cost


def test_a_saturated_unit_is_as_far_within_as_the_nearer_of_its_ends():
    """z = 3/4 x lies in [-0.6, 0.3] and then shrinks: of the ends -1 and 1 the lower is nearer, by 0.4."""
    plant, inc = Plant([[0.5]], [[0.125]]), INC([[0.0]], [[0.75]], [[1.0]], [[0.0]], activation=Saturation())
    claim = Regional(Box([-0.8], [0.4]), None, [[1.0]], [[1.0]], 0.9)
    loop = PiecewiseLoop(plant, inc)
    terminal = find(loop, claim)[0]
    found = cell_walk(loop, claim, replace(terminal, level=terminal.level / 10**4))
    places = replace(loop, arithmetic="fixed")
    laws = placed_laws(places, found.trails.patterns)
    moved = motions(places, claim, found.trails, laws)
    points = refined(found.arrived, *planes(found, claim.initial.support, laws, moved)).points
    passages = Passages(found, claim, laws, moved, points)
    assert passages.passage(0, np.array([0])).beyond[0, 0] == pytest.approx(-0.4, abs=1e-8)
