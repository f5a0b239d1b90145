"""Panels over a plane of states: the initial set cut into its pieces, motions, the terminal ellipsoid, the cost."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch, Polygon
from matplotlib.tri import Triangulation

from ..arrays import Array
from ..loop import equilibrium
from ..pieces.laws import PiecewiseLoop
from ..sets import Box, Ellipsoid, Gaussian, Polytope
from .meshes import grid_in_triangle
from .motions import Motions
from .style import QUIET, WORST, colour, ground, law_name, name_of, tint

MOST_LAWS = 7
FINEST, MOST_TRIANGLES = 12, 40_000


def draw_plane(axes: Any, result: Any, shown: Motions | None) -> None:
    """Draw the plane of two states: the initial set (cut into certified pieces where there is a regional proof),
    motions, and the terminal ellipsoid that they end in."""
    walk = regional_walk(result)
    handles = _draw_pieces(axes, result, walk) if walk is not None else _draw_initial(axes, result.spec.initial)
    if shown is not None:
        handles += _draw_motions(axes, shown)
    if walk is not None:
        handles += _draw_terminal(axes, result)
    axes.set_xlabel("state " + name_of("x", 0, 2))
    axes.set_ylabel("state " + name_of("x", 1, 2))
    axes.grid(True, color="0.92", zorder=0)
    axes.set_axisbelow(True)
    if handles:  # below the plane, where it covers no motion
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.12), fontsize="small", frameon=False,
                    ncols=3)


def draw_cost(axes: Any, result: Any, walk: Any) -> None:
    """Draw the exact discounted cost from every starting point of the initial set, for one or two states."""
    worst, point = result.certificate.worst
    if result.plant.n == 1:
        _draw_cost_line(axes, walk)
        axes.plot(point[0], worst, "*", color=WORST, ms=11, clip_on=False)
        axes.set_xlabel("starting point $x_0$")
        axes.set_ylabel("discounted cost from there")
        axes.grid(True, color="0.92")
    else:
        triangles, cost = lattice(walk.done.start, walk.done.cost)
        filled = axes.tricontourf(triangles, cost, levels=14, cmap="cividis")
        filled.set_edgecolor("face")  # else viewers show hairlines between the bands
        axes.figure.colorbar(filled, ax=axes, label="discounted cost from $x_0$")
        axes.plot(*point, "*", color="white", mec=WORST, ms=13, clip_on=False, zorder=5)
        axes.set_xlabel("starting point " + name_of("x", 0, 2))
        axes.set_ylabel("starting point " + name_of("x", 1, 2))
        axes.use_sticky_edges = False
        axes.margins(0.05)  # room for the star
    axes.set_title(f"Cost from each starting point, exact; largest {worst:.5g} (star)", fontsize="medium")


def regional_walk(result: Any) -> Any:
    """Return the completed walk of a result's regional certificate, or None when there is none."""
    walk = getattr(result.certificate, "walk", None)
    return walk if walk is not None and walk.complete else None


def lattice(start: Array, cost: Array) -> tuple[Triangulation, Array]:
    """Return a fine triangulation of triangles (N, 3, 2) and the cost l'c l at its nodes, l barycentric, c (N, 3, 3).

    >>> triangles, value = lattice(np.array([[[0., 0.], [1., 0.], [0., 1.]]]), np.eye(3)[None])
    >>> float(value.max()), len(triangles.triangles)
    (1.0, 144)
    """
    k = int(np.clip(np.sqrt(MOST_TRIANGLES / len(start)), 1, FINEST))
    weights, cells = grid_in_triangle(k)
    points = np.einsum("ak,ski->sai", weights, start).reshape(-1, 2)
    values = np.einsum("ak,skl,al->sa", weights, cost, weights).ravel()
    shifted = (cells[None] + len(weights) * np.arange(len(start))[:, None, None]).reshape(-1, 3)
    return Triangulation(points[:, 0], points[:, 1], shifted), values


def _draw_cost_line(axes: Any, walk: Any) -> None:
    share = np.linspace(0, 1, 21)
    weights = np.stack([1 - share, share], axis=1)
    x = np.einsum("ak,ski->sa", weights, walk.done.start)
    values = np.einsum("ak,skl,al->sa", weights, walk.done.cost, weights)
    for line, value in zip(x, values, strict=True):
        axes.plot(line, value, color=colour(0), lw=1.8)


def _draw_pieces(axes: Any, result: Any, walk: Any) -> list[Any]:
    """Fill the pieces, coloured by the law of the first step, or by the step of arrival when there are many laws."""
    start = walk.done.start
    law, names = _laws(result, start)
    line = 0.6 if len(start) <= 1500 else 0.0
    if len(names) <= MOST_LAWS:
        face = [ground(i) for i in law]
        handles = [Patch(facecolor=ground(i), edgecolor="white", label=name) for i, name in enumerate(names)]
        axes.add_collection(PolyCollection(list(start), facecolors=face, edgecolors="white", linewidths=line))
    else:
        handles = []
        _draw_arrivals(axes, walk, line)
    axes.update_datalim(start.reshape(-1, 2))
    axes.autoscale_view()
    axes.set_title(f"Initial set in {len(start)} pieces, each followed exactly", fontsize="medium")
    return handles


def _draw_arrivals(axes: Any, walk: Any, line: float) -> None:
    last = int(walk.arrival.max())
    palette = ListedColormap([tint(colour(0), share) for share in np.linspace(0.08, 0.75, last + 1)])
    scale = BoundaryNorm(np.arange(last + 2) - 0.5, palette.N)
    filled = PolyCollection(list(walk.done.start), cmap=palette, norm=scale, edgecolors="white", linewidths=line)
    filled.set_array(walk.arrival.astype(float))
    axes.add_collection(filled)
    ticks = np.arange(0, last + 1, -(-(last + 1) // 8))
    axes.figure.colorbar(filled, ax=axes, label="step of arrival in the terminal set", ticks=ticks)


def _laws(result: Any, start: Array) -> tuple[np.ndarray, list[str]]:
    """Return which affine law holds first on each piece, and the laws as formulas; equal laws count once."""
    loop = PiecewiseLoop(result.plant, result.inc.without_idle_units())
    patterns, which = np.unique(loop.patterns_at(start.mean(axis=1)), axis=0, return_inverse=True)
    laws = loop.laws(patterns)
    table = np.concatenate([laws.Gx.reshape(len(patterns), -1), laws.g], axis=1)
    size = max(float(np.max(np.abs(table), initial=0.0)), 1e-300)
    _, first, same = np.unique(np.round(table / size, 9), axis=0, return_index=True, return_inverse=True)
    return same.ravel()[which.ravel()], [law_name(laws.Gx[i], laws.g[i]) for i in first]


def _draw_initial(axes: Any, initial: Any) -> list[Any]:
    """Outline the set that carries the initial distribution; of a Gaussian its two-sigma ellipse, else its points."""
    support = initial.support
    if isinstance(initial, Gaussian):
        outline, name = ellipse(initial.mean, np.linalg.inv(initial.covariance), 4.0), "two standard deviations"
    elif isinstance(support, Ellipsoid):
        outline, name = ellipse(support.center, support.P, support.level), "initial set"
    elif isinstance(support, Box | Polytope):
        outline, name = _around(support.vertices), "initial set"
    else:
        axes.plot(*initial.points, ".", color=QUIET, ms=3)
        return []
    shape = Polygon(outline.T, closed=True, facecolor=tint(colour(5), 0.25), edgecolor=QUIET, label=name)
    axes.add_patch(shape)
    axes.update_datalim(outline.T)
    axes.autoscale_view()
    return [shape]


def _draw_motions(axes: Any, shown: Motions) -> list[Any]:
    x = shown.run.x
    order = [i for i in range(x.shape[1]) if i != shown.worst]
    handles = []
    for i in order:
        axes.plot(x[0, i], x[1, i], "-o", color=QUIET, lw=0.8, ms=2.2, zorder=3)
        axes.plot(x[0, i, 0], x[1, i, 0], "o", color=QUIET, ms=4, mfc="white", zorder=4)
    worst, = axes.plot(x[0, shown.worst], x[1, shown.worst], "-o", color=WORST, lw=1.6, ms=3.5, zorder=5,
                       label=f"from the {shown.marked}")
    axes.plot(x[0, shown.worst, 0], x[1, shown.worst, 0], "o", color=WORST, mfc="white", ms=6, zorder=6)
    handles.append(worst)
    return handles


def _draw_terminal(axes: Any, result: Any) -> list[Any]:
    center = equilibrium(result.plant, result.inc).x
    outline = ellipse(center, result.certificate.P, result.certificate.level)
    line, = axes.plot(*np.column_stack([outline, outline[:, :1]]), color=colour(1), lw=1.6, ls="--", zorder=4,
                      label="terminal ellipsoid")
    return [line]


def ellipse(center: Array, P: Array, level: float, points: int = 181) -> Array:
    """Return points (2, N) on {x: (x - center)'P (x - center) = level}.

    >>> ellipse(np.zeros(2), np.diag([4.0, 1.0]), 1.0, 2).round(6).tolist()
    [[0.5, -0.5], [0.0, 0.0]]
    """
    angle = 2 * np.pi * np.arange(points) / points
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(center)[:, None] + np.sqrt(level) * np.linalg.solve(np.linalg.cholesky(P).T, circle)


def _around(vertices: Array) -> Array:
    """Order the vertices (2, N) of a convex polygon by angle about their mean."""
    offset = vertices - vertices.mean(axis=1, keepdims=True)
    return vertices[:, np.argsort(np.arctan2(offset[1], offset[0]))]
