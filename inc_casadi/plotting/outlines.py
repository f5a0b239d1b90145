"""Unions of convex polygons, drawn as one shape without a seam inside."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from ..arrays import Array
from ..errors import InvalidInputError
from .style import name_of

THIN = 0.01  # a set smaller than this share of the axes is marked by a dot as well


def hull(points: Array) -> Array:
    """Return the corners (k, 2) of the convex hull of points (N, 2), counterclockwise; fewer than three when it is flat.

    Andrew's monotone chain: points in lexicographic order, a corner is dropped where the chain does not turn left.

    >>> hull(np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.5, 0.0], [0.0, 1.0]])).tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered)
    chains = []
    for direction in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for p in direction:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        chains += chain[:-1]
    return np.array(chains)


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def around(polygons: Sequence[Array]) -> tuple[Array, np.ndarray]:
    """Return all corners (M, 2), those of each convex polygon counterclockwise in turn, and how many each has.

    polygons: the corners (N, 2) of each in any order, no other points among them. Sorted by angle about their mean.

    >>> around([np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0]])])[0].tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
    """
    counts = np.array([len(points) for points in polygons])
    corners, owner = np.concatenate(polygons), np.repeat(np.arange(len(counts)), counts)
    middle = np.add.reduceat(corners, np.cumsum(counts) - counts, axis=0) / counts[:, None]
    offset = corners - middle[owner]
    return corners[np.lexsort((np.arctan2(offset[:, 1], offset[:, 0]), owner))], counts


def union_path(polygons: Sequence[Array]) -> Path:
    """Return one path through the outlines of convex polygons, each given by its corners (N, 2) in any order.

    All turn counterclockwise, and the renderers fill where the winding number is not zero: so the union is filled, once
    where polygons overlap, and without hairlines where they touch.

    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> union_path([square, square + 1]).vertices.shape
    (10, 2)
    """
    corners, counts = around(polygons)
    ends = np.cumsum(counts)
    vertices = np.insert(corners, ends, corners[ends - counts], axis=0)  # each outline ends where it began
    codes = np.full(len(vertices), Path.LINETO, dtype=Path.code_type)
    last = ends + np.arange(len(ends))
    codes[last - counts], codes[last] = Path.MOVETO, Path.CLOSEPOLY
    return Path(vertices, codes)


def draw_union(axes: Any, polygons: Sequence[Array], face: Any, edge: Any, zorder: float = 1.0) -> None:
    """Draw the union of convex polygons (N, 2) with its outline.

    All outlines are drawn first, the filled union over them: only the outer half of the outer lines remains.
    """
    if len(polygons):
        path = union_path(polygons)
        add_quickly(axes, PathPatch(path, facecolor="none", edgecolor=edge, lw=1.2, joinstyle="bevel", zorder=zorder))
        add_quickly(axes, PathPatch(path, facecolor=face, edgecolor="none", zorder=zorder + 0.01))


def add_quickly(axes: Any, patch: PathPatch) -> None:
    """Add a patch of straight lines to axes: `add_patch` takes seconds to search many segments for curves."""
    axes.add_artist(patch)
    axes.update_datalim(patch.get_path().vertices)
    axes.autoscale_view()


def mark_small(axes: Any, box: Array, size: Array, face: Any, zorder: float) -> None:
    """Put a dot on a set whose box (2, 2), lower and upper ends, is too small to be seen on axes of that size (2,)."""
    if np.all(box[1] - box[0] <= THIN * size):
        axes.plot(*box.mean(axis=0)[:, None], "o", color=face, ms=3.5, zorder=zorder)


def as_plane(axes: Any) -> None:
    """Name the axes of a plane of two states and put a quiet grid behind it."""
    axes.set_xlabel("state " + name_of("x", 0, 2))
    axes.set_ylabel("state " + name_of("x", 1, 2))
    axes.grid(True, color="0.92", zorder=0)
    axes.set_axisbelow(True)


def legend_below(figure: Any, handles: list[Any], columns: int = 3) -> None:
    """Put a legend below the axes, where it covers nothing."""
    if handles:
        figure.legend(handles=handles, loc="outside lower center", fontsize="small", frameon=False, ncols=columns)


def legend_beside(axes: Any, handles: list[Any], columns: int, own: bool) -> None:
    """Put a legend below the axes: of the whole figure where it is our own, else of the caller's axes alone."""
    if own:
        legend_below(axes.figure, handles, columns)
    elif handles:
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), fontsize="small", frameon=False,
                    ncols=columns)


def require_plane(what: str, n: int) -> None:
    """Raise InvalidInputError unless n, the number of states of `what`, is 2."""
    if n != 2:
        raise InvalidInputError(f"{what} has {n} states, but the picture is a plane: 2 states are needed")
