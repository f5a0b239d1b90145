"""A walk over polytopes repeated with 256 binary places and every error bounded: what settles a regional claim at size."""

from __future__ import annotations

import time
from dataclasses import dataclass
from fractions import Fraction
from math import factorial
from typing import Any

import numpy as np

from ..blocks import exact
from ..claims.regional import Regional
from .begin import Begin, begin_of
from .cell_enclosure import CellEnclosure, enclose_cells, largest
from .cell_motions import Motions, PlacedLaws, in_start, motions, placed_laws, planes
from .cell_steps import Passages
from .cell_vertices import Vertices, refined, trouble
from .cell_walk import MOST_DIMENSIONS, CellWalk
from .cells import simplices_of
from .cutting import Deadline
from .enclosure import Step
from .fixed import ONE, PLACES, RESOLUTION
from .laws import PiecewiseLoop
from .linear import determinant
from .places import Places, determinants, floats, placed, times
from .terminal import TerminalSet

BATCH = 2_000  # simplices between two looks at the clock
FINER = 128  # binary places by which the levels of cuts are lowered where the incidence allows it


@dataclass(frozen=True, eq=False)
class Settled:
    """What a walk comes to with 256 places: bounds on all errors, and the costs that the rounded cells have.

    expected: None in more than 8 dimensions; arrived: whether every vertex ends within the terminal set.
    """

    enclosure: CellEnclosure
    steps: tuple[Step, ...]
    arrived: bool
    expected: Fraction | None
    worst: Fraction


def settle(walk: CellWalk, loop: PiecewiseLoop, claim: Regional, terminal: TerminalSet,
           deadline: Deadline | None = None, begin: Begin | None = None) -> Settled | str:
    """Follow the vertices of a walk's cells with 256 places, or say why its cells cannot be trusted.

    loop: in "fixed" arithmetic; terminal: with 256 places and a lowered level (`in_places`); deadline: when to give up;
    begin: where the walk began, by default anywhere in the claim's initial set. The cells come from a walk in floats and are
    believed in nothing:

    * each cell is the set of starting points between planes that are defined anew with 256 places, from the law under
      which each cut was made. A cut leaves a x0 <= b on one side and a x0 >= b on the other, so the cells cover the initial
      set, whatever the numbers a and b are, as long as the walk has kept both: that none was lost or doubled also shows in
      their volumes, in up to 8 dimensions;
    * a cell is the convex hull of its listed vertices (`cell_vertices.trouble`);
    * the law of the cell's pattern at each step is affine, so that the states, inputs and z of all its points lie between
      those of its vertices; how far a z lies beyond its piece, and all rounding, is accounted for cell by cell
      (`cell_enclosure.enclose_cells`);
    * the cost form of a cell is convex in x0, so its maximum is at a vertex; its integral is summed over a triangulation.
    """
    deadline = deadline or Deadline(0, float("inf"), time.monotonic())
    if len(walk.alive) or not len(walk.arrived):
        return "the walk has not followed every starting point"
    begin = begin_of(claim.initial.support) if begin is None else begin  # type: ignore[arg-type]
    region = begin.region
    laws = placed_laws(loop, walk.trails.patterns)
    moved = motions(loop, claim, walk.trails, laws, begin)
    vertices = _sound_vertices(walk, region, laws, moved)
    if isinstance(vertices, str):
        return vertices
    passages = Passages(walk, claim, laws, moved, vertices.points)
    enclosed = enclose_cells(loop, claim, terminal, passages, vertices.error, deadline)
    if isinstance(enclosed, str):
        return enclosed
    enclosure, steps, arrived = enclosed
    form = moved.cost[walk.node] + _tails(walk, claim, terminal, moved)
    corner = _values(form[walk.arrived.owner], vertices.points)
    late = deadline.passed(0)
    expected: Fraction | None = None
    if late:
        return late
    if region.dimension <= MOST_DIMENSIONS:
        mean = _expected(walk, region, form, corner, vertices, deadline)
        if isinstance(mean, str):
            return mean
        expected = mean
    worst = Fraction(int(corner.max()) + 1, ONE)
    return Settled(enclosure, steps, arrived, expected, worst)


def _sound_vertices(walk: CellWalk, region: Any, laws: PlacedLaws, moved: Motions) -> Vertices | str:
    """The vertices, or why these are not all. Cuts beside vertices are tried much nearer to them first."""
    for finer in (FINER, 0):
        a, b = planes(walk, region, laws, moved, finer)
        vertices = refined(walk.arrived, a, b)
        wrong = vertices if isinstance(vertices, str) else trouble(walk.arrived, a, b, vertices)
        if not wrong:
            break
    return wrong or vertices


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


def _expected(walk: CellWalk, region: Any, form: Places, corner: Places, vertices: Vertices,
              deadline: Deadline) -> Fraction | str:
    """The mean of the cells' cost forms over the initial set, rounded up by more than all rounding on the way.

    A reason when the time is over, or the volumes of the cells do not add up to that of the initial set.

    On a simplex the mean of c is (sum_i c(v_i) + s'c s) / ((n + 1)(n + 2)), s the sum of the lifted vertices. A coordinate
    is off by `error` >= 2^-256, so a determinant of n edges of size at most M by n n! (2 M)^(n - 1) 2 error and more by
    rounding, and a value of c, with entries below C, by (n + 1)^2 C (2 M + 1) error and more; all of it, for S simplices,
    is below S n! (4 M + 4)^(n + 4) (C + 1) 64 error.
    """
    cells, n = walk.arrived, walk.arrived.start.shape[1]
    corners, owner = simplices_of(cells)
    volume, weighted = 0, 0
    for begin in range(0, len(corners), BATCH):
        late = deadline.passed(0)
        if late:
            return late
        batch = slice(begin, begin + BATCH)
        points = vertices.points[corners[batch]]
        share = np.abs(determinants(points[:, 1:] - points[:, :1]))
        lifted = np.concatenate([points, np.full((*points.shape[:2], 1), 1 << PLACES, dtype=object)], axis=2).sum(axis=1)
        mean = times(times(lifted[:, None, :], form[owner[batch]]), lifted[:, :, None])[:, 0, 0]
        mean = mean + corner[corners[batch]].sum(axis=1)
        volume, weighted = volume + int(share.sum()), weighted + int((share * mean).sum())
    total = Fraction(weighted, ONE * ONE * (n + 1) * (n + 2))
    M, C = largest(floats(vertices.points)), largest(floats(form))
    slop = len(corners) * factorial(n) * (4 * M + 4) ** (n + 4) * 64 * max(vertices.error, RESOLUTION)
    whole = sum((abs(determinant(exact(simplex[1:]) - exact(simplex[0]))) for simplex in region.simplices()), Fraction(0))
    if abs(Fraction(volume, ONE) - whole) > Fraction(slop):
        return "the volumes of the cells do not add up to that of the initial set"
    return (total + Fraction(slop * (C + 1))) / whole
