"""A walk over polytopes repeated with 256 binary places and every error bounded: what settles a regional claim at size."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import factorial
from typing import Any

import numpy as np

from ..claims.regional import Regional
from .cell_motions import Motions, PlacedLaws, in_start, motions, placed_laws, planes
from .cell_vertices import Vertices, refined, trouble
from .cell_walk import MOST_DIMENSIONS, CellWalk
from .cells import simplices_of
from .enclosure import Arrival, Enclosure, Rounding, Step, enclose
from .fixed import ONE, PLACES, RESOLUTION
from .laws import PiecewiseLoop
from .places import Places, determinants, floats, placed, times
from .terminal import TerminalSet

FINER = 128  # binary places by which the levels of cuts are lowered where the incidence allows it
CLEAR = 1e-9  # in floats, what lies within a bound by this share of its terms certainly does


@dataclass(frozen=True, eq=False)
class Settled:
    """What a walk comes to with 256 places: bounds on all errors, and the costs that the rounded cells have.

    expected: None in more than 8 dimensions; arrived: whether every vertex ends within the terminal set.
    """

    enclosure: Enclosure
    steps: tuple[Step, ...]
    arrived: bool
    expected: Fraction | None
    worst: Fraction


def settle(walk: CellWalk, loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet) -> Settled | str:
    """Follow the vertices of a walk's cells with 256 places, or say why its cells cannot be trusted.

    loop: in "fixed" arithmetic; terminal: with 256 places and a lowered level (`in_places`). The cells come from a walk in
    floats and are believed in nothing:

    * each cell is the set of starting points between planes that are defined anew with 256 places, from the law under
      which each cut was made. A cut leaves a x0 <= b on one side and a x0 >= b on the other, so the cells cover the initial
      set, whatever the numbers a and b are;
    * a cell is the convex hull of its listed vertices (`cell_vertices.trouble`);
    * the law of the cell's pattern at each step is affine, so that the states, inputs and z of all its points lie between
      those of its vertices; how far a z lies beyond its piece, and all rounding, is accounted for by `enclose`;
    * the cost form of a cell is convex in x0, so its maximum is at a vertex; its integral is summed over a triangulation.
    """
    region = claim.initial.support
    laws = placed_laws(loop, walk.trails.patterns)
    moved = motions(loop, claim, walk.trails, laws)
    a, b, vertices = _sound_vertices(walk, region, laws, moved)
    if isinstance(vertices, str):
        return vertices
    cells = walk.arrived
    steps = _steps(walk, claim, laws, moved, vertices)
    node = walk.node[cells.owner]
    last = times(moved.F[node], vertices.points[:, :, None])[:, :, 0] + moved.f[node]
    e = last - placed(terminal.x)
    size = (e * times(placed(terminal.P), e[:, :, None])[:, :, 0] >> PLACES).sum(axis=1)
    form = moved.cost[walk.node] + _tails(walk, claim, terminal, moved)
    corner = _values(form[cells.owner], vertices.points)
    arrival = Arrival(len(cells), np.abs(floats(last)).max(axis=0), 1.0)
    rounding = _rounding(loop, claim, terminal, laws, moved, steps, arrival, _largest(vertices.points))
    enclosure = enclose(loop, claim, terminal, steps, arrival, start=vertices.error, rounding=rounding)
    expected = None
    if loop.plant.n <= MOST_DIMENSIONS:
        expected = _expected(walk, region, form, corner, vertices)
    worst = Fraction(int(corner.max()) + 1, ONE)
    return Settled(enclosure, steps, bool(np.all(size <= placed(terminal.level))), expected, worst)


def _sound_vertices(walk: CellWalk, region: Any, laws: PlacedLaws, moved: Motions) -> tuple[Places, Places, Vertices | str]:
    """The planes and the vertices, or why these are not all. Cuts beside vertices are tried much nearer to them first."""
    for finer in (FINER, 0):
        a, b = planes(walk, region, laws, moved, finer)
        vertices = refined(walk.arrived, a, b)
        wrong = vertices if isinstance(vertices, str) else trouble(walk.arrived, a, b, vertices)
        if not wrong:
            break
    return a, b, wrong or vertices


def _largest(array: Places) -> float:
    return float(np.max(np.abs(floats(array)), initial=1.0))


def _rounding(loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet, laws: PlacedLaws, moved: Motions,
              steps: tuple[Step, ...], arrival: Arrival, V: float) -> Rounding:
    """What rounding can do, with X, V, F, G, B, ... >= 1 the largest magnitudes of states, vertices, maps, laws, B, ...

    The laws and the matrices A + B Gx are off by at most 2 + m B roundings, and x -> F x0 + f is rounded once in each step,
    so a step is off by (2 + m B)(n X + 1) + n V + 2 roundings; z and u by n X + 2, and n G more from x. A value h - H u or
    e'P e has m H or 2 n^2 P X times that and as many roundings of its own. A cost form comes from products of two maps
    with a form of entries C, each off by a rounding of the map, in each step, and is taken at vertices.
    """
    plant, n, m = loop.plant, loop.plant.n, loop.plant.m
    X = max([1.0, *(float(np.max(step.x)) for step in steps), float(np.max(arrival.x))])
    G, F = max(_largest(laws.Gx), _largest(laws.g), _largest(laws.Zx)), max(_largest(moved.F), _largest(moved.f))
    B, H = max(1.0, float(np.max(np.abs(plant.B)))), 1.0
    if claim.inputs is not None:
        H = max(1.0, float(np.max(np.abs(claim.inputs.H))), float(np.max(np.abs(claim.inputs.h))))
    C = max(1.0, *(float(np.max(np.abs(part.astype(float)))) for part in (claim.Q, claim.R, terminal.tail)))
    P = max(1.0, float(np.max(np.abs(terminal.P.astype(float)))))
    formula = 8 * RESOLUTION * (n + m + 2) * (2 + m * B) * (X + V + G)
    stage = 64 * RESOLUTION * (n + m + 1) ** 4 * G**2 * C * (F + X) ** 2 * V**2
    return Rounding(formula, 8 * (n + m) ** 2 * H * P * X * formula, stage * (len(steps) + 2) ** 2)


def _tails(walk: CellWalk, claim: Regional, terminal: TerminalSet, moved: Motions) -> Places:
    """The tail costs of the cells as forms in (x0, 1)."""
    scale = [1 << PLACES]
    for _ in range(int(walk.steps_taken.max(initial=0))):
        scale.append(scale[-1] * int(placed(np.array(claim.discount))) >> PLACES)
    tail = np.broadcast_to(placed(terminal.tail), (len(walk.node), *terminal.tail.shape))
    form = in_start(tail, moved.F[walk.node], moved.f[walk.node] - placed(terminal.x))
    return form * np.array(scale, dtype=object)[walk.steps_taken][:, None, None] >> PLACES


def _values(forms: Places, points: Places) -> Places:
    """The values (M,) of forms (M, n + 1, n + 1) at (x, 1)."""
    lifted = np.concatenate([points, np.full((len(points), 1), 1 << PLACES, dtype=object)], axis=1)
    return times(times(lifted[:, None, :], forms), lifted[:, :, None])[:, 0, 0]


def _steps(walk: CellWalk, claim: Regional, laws: PlacedLaws, moved: Motions, vertices: Vertices) -> tuple[Step, ...]:
    """What the error bound needs to know of each step: how far z leaves its piece, magnitudes, the room of the inputs."""
    cells, trails = walk.arrived, walk.trails
    count = int(walk.steps_taken.max(initial=0))
    chain = np.full((count + 1, len(cells)), -1)
    rows = np.arange(len(cells))
    chain[walk.steps_taken, rows] = walk.node
    for step in range(count, 0, -1):
        under_way = chain[step] >= 0
        chain[step - 1, under_way] = trails.parent[chain[step, under_way]]
    x0 = floats(vertices.points)
    return tuple(_step(cells.owner, x0, vertices.points, chain[k], chain[k + 1], trails.pattern, claim, laws, moved)
                 for k in range(count))


def _step(owner: np.ndarray, rough: np.ndarray, points: Places, at: np.ndarray, after: np.ndarray, pattern: np.ndarray,
          claim: Regional, laws: PlacedLaws, moved: Motions) -> Step:
    mine = np.flatnonzero(after[owner] >= 0)
    node, law = at[owner[mine]], pattern[after[owner[mine]]]
    nodes, which = np.unique(node, return_inverse=True)
    F, f = floats(moved.F[nodes])[which], floats(moved.f[nodes])[which]
    x = (F @ rough[mine, :, None])[:, :, 0] + f
    reach = (np.abs(F) @ np.abs(rough[mine, :, None]))[:, :, 0] + np.abs(f)
    Zx, z0 = floats(laws.Zx)[law], floats(laws.z0)[law]
    z = (Zx @ x[:, :, None])[:, :, 0] + z0
    terms = (np.abs(Zx) @ reach[:, :, None])[:, :, 0] + np.abs(z0)
    Gx, g = floats(laws.Gx)[law], floats(laws.g)[law]
    u_reach = (np.abs(Gx) @ reach[:, :, None])[:, :, 0] + np.abs(g)
    beyond = 0.0
    for ends, sign in ((laws.low, -1), (laws.high, 1)):
        limit = _with_infinity(ends, sign)[law]
        near = np.nonzero(sign * (z - limit) > -CLEAR * (terms + np.where(np.isfinite(limit), np.abs(limit), 0.0)))
        if near[0].size:
            fine = _fine(points[mine[near[0]]], node[near[0]], laws.Zx[law[near[0]], near[1]],
                         laws.z0[law[near[0]], near[1]], moved)
            beyond = max(beyond, float(np.max(floats(sign * (fine - ends[law[near[0]], near[1]])))))
    slack = np.inf
    if claim.inputs is not None:
        slack = _slack(claim, points, mine, node, law, laws, moved, (Gx @ x[:, :, None])[:, :, 0] + g, u_reach)
    largest = max(float(np.max(part, initial=0.0)) for part in (np.abs(Zx), np.abs(z0), np.abs(Gx), np.abs(g), reach))
    return Step(0, beyond, reach.max(axis=0), u_reach.max(axis=0), slack, largest, len(mine))


def _with_infinity(ends: Places, sign: int) -> np.ndarray:
    out = np.full(ends.shape, sign * np.inf)
    there = np.array([[end is not None for end in row] for row in ends], dtype=bool).reshape(ends.shape)
    if there.any():
        out[there] = floats(ends[there])
    return out


def _fine(points: Places, node: np.ndarray, gradient: Places, offset: Places, moved: Motions) -> Places:
    x = times(moved.F[node], points[:, :, None])[:, :, 0] + moved.f[node]
    return times(gradient[:, None, :], x[:, :, None])[:, 0, 0] + offset


def _slack(claim: Regional, points: Places, mine: np.ndarray, node: np.ndarray, law: np.ndarray, laws: PlacedLaws,
           moved: Motions, u: np.ndarray, u_reach: np.ndarray) -> float:
    """The smallest h - H u at the vertices: in floats where it is clear, with all places where it is not."""
    assert claim.inputs is not None
    H, h = np.asarray(claim.inputs.H), np.asarray(claim.inputs.h)
    room = h - u @ H.T
    terms = np.abs(h) + u_reach @ np.abs(H).T
    near = np.nonzero(room <= CLEAR * terms)
    clear = room > CLEAR * terms
    least = float(np.min(np.where(clear, room - CLEAR * terms, np.inf), initial=np.inf))
    if near[0].size:
        gradient = times(placed(H)[near[1]][:, None, :], laws.Gx[law[near[0]]])[:, 0]
        offset = times(placed(H)[near[1]][:, None, :], laws.g[law[near[0]]][:, :, None])[:, 0, 0]
        value = placed(h)[near[1]] - _fine(points[mine[near[0]]], node[near[0]], gradient, offset, moved)
        least = min(least, float(np.min(floats(value))))
    return least


def _expected(walk: CellWalk, region: object, form: Places, corner: Places, vertices: Vertices) -> Fraction:
    """The mean of the cells' cost forms over the initial set, rounded up by more than all rounding on the way.

    On a simplex the mean of c is (sum_i c(v_i) + s'c s) / ((n + 1)(n + 2)), s the sum of the lifted vertices. A coordinate
    is off by `error` >= 2^-256, so a determinant of n edges of size at most M by n n! (2 M)^(n - 1) 2 error and more by
    rounding, and a value of c, with entries below C, by (n + 1)^2 C (2 M + 1) error and more; all of it, for S simplices,
    is below S n! (4 M + 4)^(n + 4) (C + 1) 64 error.
    """
    cells, n = walk.arrived, walk.arrived.start.shape[1]
    corners, owner = simplices_of(cells)
    points = vertices.points[corners]
    volume = np.abs(determinants(points[:, 1:] - points[:, :1]))
    lifted = np.concatenate([points, np.full((*points.shape[:2], 1), 1 << PLACES, dtype=object)], axis=2).sum(axis=1)
    mean = corner[corners].sum(axis=1) + times(times(lifted[:, None, :], form[owner]), lifted[:, :, None])[:, 0, 0]
    total = Fraction(int((volume * mean).sum()), ONE * ONE * (n + 1) * (n + 2))
    M, C = max(1.0, _largest(vertices.points)), _largest(form)
    slop = len(corners) * factorial(n) * (4 * M + 4) ** (n + 4) * (C + 1) * 64 * max(vertices.error, RESOLUTION)
    whole = sum((_volume(simplex) for simplex in region.simplices()), Fraction(0))  # type: ignore[attr-defined]
    return (total + Fraction(slop)) / whole


def _volume(simplex: np.ndarray) -> Fraction:
    """n! times the volume of a simplex (n + 1, n), exactly."""
    from ..blocks import exact
    from .walk import _determinant

    corners = exact(simplex)
    return abs(_determinant(corners[1:] - corners[0]))
