"""The affine maps, cost forms and cutting planes of a walk over polytopes, worked out again with 256 binary places."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..blocks import exact
from ..claims.regional import Regional
from ..sets import Box, Polytope
from .begin import Begin, begin_of
from .cell_walk import CellWalk
from .laws import PiecewiseLoop
from .layered import layered_laws
from .linear import solve
from .places import Places, placed, scaled, times
from .trails import Trails


@dataclass(frozen=True, eq=False)
class PlacedLaws:
    """The laws of a walk's patterns as multiples of 2^-256: z = Zx x + z0, u = Gx x + g, x+ = Ax x + a, and the ends of z.

    low, high (P, q): the ends of the pieces, None where there is none.
    """

    Zx: Places
    z0: Places
    Gx: Places
    g: Places
    Ax: Places
    a: Places
    low: Places
    high: Places


def placed_laws(loop: PiecewiseLoop, patterns: np.ndarray) -> PlacedLaws:
    """Return the laws of patterns (P, q) to less than 2 roundings; loop: one in "fixed" arithmetic.

    Where W is feedforward they are summed level by level with more places (`layered.layered_laws`), else each is solved in
    Fractions.
    """
    layered = layered_laws(loop, patterns)
    laws, plant = layered or loop.laws(patterns), loop.plant
    Zx, z0, Gx, g = (placed(part) if layered is None else part for part in (laws.Zx, laws.z0, laws.Gx, laws.g))
    A, B = placed(plant.A), placed(plant.B)
    return PlacedLaws(Zx, z0, Gx, g, A + times(B, Gx), times(g, B.T), _ends(laws.low), _ends(laws.high))


def _ends(ends: np.ndarray) -> Places:
    finite = np.isfinite(ends.astype(float))
    out = np.full(ends.shape, None, dtype=object)
    if finite.any():
        out[finite] = placed(ends[finite])
    return out


@dataclass(frozen=True, eq=False)
class Motions:
    """For each node of a walk's tree: x = F x0 + f at its step, (T, n, k) and (T, n), and the cost so far as a form
    (T, k + 1, k + 1) in (x0, 1), for x0 in R^k."""

    F: Places
    f: Places
    cost: Places


def motions(loop: PiecewiseLoop, claim: Regional, trails: Trails, laws: PlacedLaws, begin: Begin | None = None) -> Motions:
    """Return maps and costs of all nodes, one level of the tree at a time; begin: by default in the claim's initial set."""
    first, constant = (begin or begin_of(claim.initial.support)).maps()  # type: ignore[arg-type]
    n, k, T, depth = loop.plant.n, first.shape[1], len(trails.parent), trails.depth
    F, f = np.empty((T, n, k), dtype=object), np.empty((T, n), dtype=object)
    cost = np.full((T, k + 1, k + 1), 0, dtype=object)
    F[0], f[0] = first, constant
    stage = _stage_forms(claim, laws)
    scale, beta = placed(np.array(1.0)), placed(np.array(claim.discount))
    for level in range(1, int(depth.max()) + 1):
        node = np.flatnonzero(depth == level)
        before, law = trails.parent[node], trails.pattern[node]
        F[node] = times(laws.Ax[law], F[before])
        f[node] = times(laws.Ax[law], f[before][:, :, None])[:, :, 0] + laws.a[law]
        cost[node] = cost[before] + scaled(scale, in_start(stage[law], F[before], f[before]))
        scale = scaled(scale, beta)
    return Motions(F, f, cost)


def in_start(forms: Places, F: Places, f: Places) -> Places:
    """Return forms (N, n + 1, n + 1) in (x, 1) as forms (N, k + 1, k + 1) in (x0, 1), for x = F x0 + f."""
    N, n, k = F.shape
    lifted = np.full((N, n + 1, k + 1), 0, dtype=object)
    lifted[:, :n, :k], lifted[:, :n, k], lifted[:, n, k] = F, f, placed(np.array(1.0)).item()
    return times(times(np.swapaxes(lifted, 1, 2), forms), lifted)


def _stage_forms(claim: Regional, laws: PlacedLaws) -> Places:
    P, _, n = laws.Gx.shape
    input_map = np.concatenate([laws.Gx, laws.g[:, :, None]], axis=2)
    forms = times(times(np.swapaxes(input_map, 1, 2), placed(claim.R)), input_map)
    forms[:, :n, :n] = forms[:, :n, :n] + placed(claim.Q)
    return forms


def planes(walk: CellWalk, region: Box | Polytope, laws: PlacedLaws, moved: Motions,
           finer: int = 0) -> tuple[Places, Places]:
    """Return (a, b), (F, n) and (F,), of every plane a x0 = b of facets: those of the region, then those of the cuts.

    finer: by how many binary places the levels at which cuts were made are lowered. A walk in floats places a cut that
    would meet vertices some 1e-13 beside them; that it needs to do so by its rounding only.
    """
    trails, q = walk.trails, laws.z0.shape[1]
    a, b = _first_planes(walk, region)
    if not len(trails.node):
        return a, b
    unit, lower = trails.bound % q, trails.bound < q
    row, node = trails.row, trails.node
    end = np.where(lower, laws.low[row, unit], laws.high[row, unit])
    gradient, offset = laws.Zx[row, unit], laws.z0[row, unit] - end
    along = times(gradient[:, None, :], moved.F[node])[:, 0]
    beyond = times(gradient[:, None, :], moved.f[node][:, :, None])[:, 0, 0] + offset
    sign = np.where(lower, -1, 1)
    return (np.concatenate([a, sign[:, None] * along]),
            np.concatenate([b, (placed(trails.level) >> finer) - sign * beyond]))


def _first_planes(walk: CellWalk, region: Box | Polytope) -> tuple[Places, Places]:
    """The planes of the region's facets; of a polytope's simplices each is solved for in Fractions."""
    first = len(walk.arrived.planes) - len(walk.trails.node)
    if isinstance(region, Box):
        table = walk.arrived.planes[:first]
        return placed(table[:, :-1]), placed(table[:, -1])
    rows: list[Any] = []
    for corners in region.simplices():
        n = corners.shape[1]
        lifted = exact(np.column_stack([corners, np.ones(n + 1)]))
        coordinates = solve(lifted, exact(np.eye(n + 1)))
        rows += [np.append(-column[:n], column[n]) for column in coordinates.T]
    table = placed(np.array(rows, dtype=object))
    return table[:, :-1], table[:, -1]
