"""Errors followed through whole walks, against true motions from starting points that are really off."""

import time
from dataclasses import replace

import numpy as np
import pytest
from reference import network, reference
from small_loops import small_loop

from inc_casadi import Box, Plant, Regional, certify
from inc_casadi.activations.stack import lipschitz, slopes
from inc_casadi.pieces import cell_enclosure, cell_steps
from inc_casadi.pieces.cell_enclosure import Magnitudes, _arrival, enclose_cells, largest
from inc_casadi.pieces.cell_motions import motions, placed_laws, planes
from inc_casadi.pieces.cell_proof import settle
from inc_casadi.pieces.cell_steps import Passages
from inc_casadi.pieces.cell_vertices import refined
from inc_casadi.pieces.cell_walk import cell_walk
from inc_casadi.pieces.cutting import Deadline
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.places import floats, placed
from inc_casadi.pieces.terminal import find, in_fractions, in_places
from inc_casadi.well_posed import error_from_residual

NEVER = Deadline(0, float("inf"), 0.0)
CASES = [(kind, seed) for kind in ("mixed", "net", "saturated", "posed", "mpc", "ties") for seed in range(1, 4)]


def followed(kind, seed, **changes):
    """A small loop, its walk ready for the error bound, and the terminal set with 256 places."""
    small = small_loop(kind, seed)
    loop, claim = PiecewiseLoop(small.plant, small.inc.without_idle_units()), replace(small.claim, **changes)
    terminal, why = find(loop, claim)
    assert terminal is not None, why
    exactly = in_places(in_fractions(replace(loop, arithmetic="exact"), claim, terminal), 1 - 2.0**-40)
    walk, places = cell_walk(loop, claim, terminal), replace(loop, arithmetic="fixed")
    laws = placed_laws(places, walk.trails.patterns)
    moved = motions(places, claim, walk.trails, laws)
    for finer in (128, 0):
        vertices = refined(walk.arrived, *planes(walk, claim.initial.support, laws, moved, finer))
        if not isinstance(vertices, str):
            break
    return small, places, claim, exactly, Passages(walk, claim, laws, moved, vertices.points)


def said(passages, vertex, nodes):
    """What the walk says of the states of a vertex at nodes."""
    return passages.F[nodes] @ floats(passages.points[vertex]) + passages.f[nodes]


@pytest.mark.parametrize(("kind", "seed", "weight"),
                         [*((*case, 1.0) for case in CASES), ("mixed", 1, 1e-6), ("net", 1, 1e-6)])
def test_motions_from_starting_points_that_are_off_stay_within_the_bound(kind, seed, weight):
    """Of states, inputs and costs, also where nearly all the cost is that of the inputs."""
    off = 1e-6
    small = small_loop(kind, seed)
    small, loop, claim, terminal, passages = followed(kind, seed, Q=weight * small.claim.Q, R=small.claim.R / weight)
    errors, steps, arrived = enclose_cells(loop, claim, terminal, passages, off, NEVER)
    walk, rng = passages.walk, np.random.default_rng(seed)
    chosen = rng.permutation(len(walk.arrived.owner))[:150]
    cell = walk.arrived.owner[chosen]
    start = floats(passages.points)[chosen] + off * rng.choice([-1.0, 1.0], (len(chosen), loop.plant.n))
    x, u = small.motions(start.T, len(steps))
    cost, forms, spare = np.zeros(len(chosen)), floats(passages.moved.cost), np.inf
    for i, (vertex, own) in enumerate(zip(chosen, cell, strict=True)):
        last = walk.steps_taken[own]
        states = said(passages, vertex, passages.chain[:last + 1, own])
        gap = np.abs(states - x[:, i, :last + 1].T)
        assert np.all(gap <= errors.state[:last + 1] + 1e-12) and np.all(gap[-1] <= errors.final[own] + 1e-12)
        law = walk.trails.pattern[passages.chain[1:last + 1, own]]
        inputs = (floats(passages.laws.Gx[law]) @ states[:-1, :, None])[:, :, 0] + floats(passages.laws.g[law])
        assert np.all(np.abs(inputs - u[:, i, :last].T) <= errors.inputs[:last] + 1e-12)
        stage = np.sum(x[:, i] * (claim.Q @ x[:, i]), axis=0) + np.sum(u[:, i] * (claim.R @ u[:, i]), axis=0)
        lifted = np.append(floats(passages.points[vertex]), 1.0)
        cost[i] = stage[:last] @ claim.discount ** np.arange(last) - lifted @ forms[walk.node[own]] @ lifted
        if claim.inputs is not None and last:
            spare = min(spare, float(np.min(claim.inputs.h[:, None] - claim.inputs.H @ u[:, i, :last])))
    assert np.max(np.abs(cost)) <= errors.cost + 1e-12 and errors.spare <= spare + 1e-12
    assert np.max(errors.state[0]) < 2 * off and len(errors.state) == len(steps) + 1 and arrived


@pytest.mark.parametrize(("kind", "seed"), [case for case in CASES if case[0] in ("net", "mixed", "saturated")])
def test_it_ends_below_the_bound_from_slopes_alone(kind, seed):
    _, loop, claim, terminal, passages = followed(kind, seed)
    errors, steps, _ = enclose_cells(loop, claim, terminal, passages, 1e-40, NEVER)
    old = from_slopes_alone(loop, steps, 1e-40, 1e-70)
    assert np.all(errors.state <= 2 * old)
    assert errors.state[-1].max() < 0.7 * old[-1].max() and len(steps) > 1


def from_slopes_alone(loop, steps, start, r):
    """The bound of `enclosure.enclose` on the states (k + 1, n), with errors `start` at first and r in every formula."""
    plant, inc = loop.plant, loop.inc
    A, B, C, U, V, K = (np.abs(part) for part in (plant.A, plant.B, plant.C, inc.U, inc.V, inc.K))
    S, guard = lipschitz(inc.activations), 1 + 1e-6
    test, ends, E = inc.well_posedness(), slopes(inc.activations), np.full(plant.n, start)
    states = [E]
    for step in steps:
        residuals = (S * (U @ (C @ E)), 2 * S * (step.beyond + r))
        hidden = sum(error_from_residual(test, inc.W, ends, residual, guard) for residual in residuals)
        E = guard * (A @ E + B @ (guard * (K @ (C @ E) + V @ hidden + r)) + r)
        states.append(E)
    return np.array(states)


def test_slopes_and_steps_in_small_parts_come_to_the_same(monkeypatch):
    _, loop, claim, terminal, passages = followed("mixed", 1)
    whole = enclose_cells(loop, claim, terminal, passages, 1e-9, NEVER)
    monkeypatch.setattr(cell_enclosure, "MOST_SLOPES", 0)
    monkeypatch.setattr(cell_steps, "MOST_NUMBERS", 200)
    assert len(list(passages.blocks(0))) > 1
    parts = enclose_cells(loop, claim, terminal, passages, 1e-9, NEVER)
    for name in ("state", "inputs", "final", "room"):
        np.testing.assert_allclose(getattr(parts[0], name), getattr(whole[0], name), rtol=1e-6)
    assert parts[0].cost == pytest.approx(whole[0].cost, rel=1e-6) and parts[0].spare == pytest.approx(whole[0].spare)
    for one, other in zip(parts[1], whole[1], strict=True):
        assert (one.pieces, one.beyond) == (other.pieces, other.beyond) and one.slack == pytest.approx(other.slack)
        np.testing.assert_allclose([*one.x, *one.u], [*other.x, *other.u], rtol=1e-12)
    assert whole[1][0].pieces == len(passages.walk.arrived) - np.sum(passages.walk.steps_taken == 0)


def test_it_gives_up_when_time_is_over_or_errors_say_nothing_more():
    _, loop, claim, terminal, passages = followed("mixed", 1)
    over = Deadline(0, 1e-9, time.monotonic() - 1)
    assert enclose_cells(loop, claim, terminal, passages, 0.0, over) == "the time limit of 1e-09 s"
    assert enclose_cells(loop, claim, terminal, passages, 1e31, NEVER) == "rounding errors grow too large"


def test_what_is_left_to_errors_where_cells_arrive():
    """A state that is off by as much as the room allows is still within the ellipsoid, in every direction."""
    _, loop, claim, terminal, passages = followed("mixed", 0)
    errors, _, _ = enclose_cells(loop, claim, terminal, passages, 1e-30, NEVER)
    P, level = terminal.P.astype(float), float(terminal.level)
    walk = passages.walk
    size = [max((e := said(passages, v, walk.node[c]) - terminal.x.astype(float)) @ P @ e
                for v in np.flatnonzero(walk.arrived.owner == c)) / level for c in range(len(walk.arrived))]
    np.testing.assert_allclose(errors.room, (1 - np.array(size)) / 2, atol=1e-9)
    ahead = errors.room[:, None] * np.sqrt(level / np.abs(P).sum())
    assert errors.arrives(terminal)
    assert replace(errors, final=0.9999 * ahead * np.ones(loop.plant.n)).arrives(terminal)
    assert not replace(errors, final=1.0001 * ahead * np.ones(loop.plant.n)).arrives(terminal)
    assert not replace(errors, rounding=float(np.min(errors.room)) ** 2 * level).arrives(terminal)


def test_arrival_at_the_very_edge_is_decided_with_all_places():
    _, _, _, terminal, passages = followed("mixed", 0)
    e = passages.walk.arrived.now - terminal.x.astype(float)
    farthest = float(np.max(np.sum(e @ terminal.P.astype(float) * e, axis=1)) / float(terminal.level))
    for share, arrives in ((farthest * (1 + 1e-11), True), (farthest * (1 - 1e-11), False)):
        edge = replace(terminal, level=terminal.level * int(share * 2**60) / 2**60)
        arrived, room, _ = _arrival(edge, passages)
        assert arrived == arrives and room.min() == pytest.approx(2.0**-42, abs=1e-11)


def test_limits_are_kept_only_with_room_for_errors():
    _, loop, claim, terminal, passages = followed("saturated", 0)
    errors, steps, _ = enclose_cells(loop, claim, terminal, passages, 1e-30, NEVER)
    assert claim.inputs is not None and errors.rounding > 0
    for spare, kept in ((2 * errors.rounding, True), (0.5 * errors.rounding, False), (-1e-30, False)):
        assert replace(errors, spare=spare).keeps_limits(claim, steps) == kept
    assert replace(errors, spare=-1.0).keeps_limits(replace(claim, inputs=None))
    least = min(step.slack for step in steps)
    assert errors.spare <= least - 0.5 * np.abs(errors.inputs).max() * 0 and abs(errors.spare - least) < 1e-25


def test_magnitudes_are_those_of_the_walk():
    _, loop, claim, terminal, passages = followed("mixed", 0)
    size = cell_enclosure.magnitudes(loop, claim, terminal, passages)
    assert largest(floats(passages.points)) == size.V and size.F >= largest(passages.F) and size.C >= np.max(np.abs(claim.Q))
    for name in ("V", "F", "G", "B", "H", "C", "P"):
        assert getattr(size, name) >= 1
    assert all(getattr(larger, of)(*at) > getattr(size, of)(*at) for larger, of, at in (
        (replace(size, G=2 * size.G), "formula", (2.0,)), (replace(size, V=2 * size.V), "formula", (2.0,)),
        (replace(size, B=2 * size.B), "formula", (2.0,)), (replace(size, H=2 * size.H), "verdict", (2.0,)),
        (replace(size, P=2 * size.P), "verdict", (2.0,)), (replace(size, C=2 * size.C), "costs", (2.0, 3)),
        (replace(size, F=2 * size.F), "costs", (2.0, 3))))
    unit = Magnitudes(1, 1, 1, 1, 1, 1, 1, 1, 1)
    assert unit.formula(1.0) == 8 * 2.0**-256 * 4 * 3 * 3
    assert placed(np.array(1.0)).item() == 1 << 256


@pytest.mark.slow
def test_a_published_net_of_75_units_is_proved_from_a_box():
    """The ReLU net of the EvanQP authors for the double integrator: bounds from slopes alone grow 2e8 times in a step."""
    data = reference("neural_controllers/evanqp_double_integrator_qp.json")
    plant = Plant(data["plant"]["A"], data["plant"]["B"])
    claim = Regional(Box([-2.0, -0.6], [2.0, 0.6]), None, np.eye(2), [[0.1]], 0.999)
    certificate = certify(plant, network(data), claim)
    walk, (loop, _) = certificate.walk, certificate._setting
    terminal = in_places(certificate._exact[1], 1 - 2.0**-40)
    settled = settle(walk, replace(loop, arithmetic="fixed"), claim, terminal)
    assert len(settled.steps) > 5 and settled.arrived and settled.enclosure.arrives(terminal)
    assert np.max(settled.enclosure.state) < 1e-48 and settled.enclosure.cost < 1e-45
    assert certificate.prove().method.startswith("256 binary places for every polytope")
