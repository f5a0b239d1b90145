"""The figure of a piecewise-affine law: its regions, coloured by the affine law that acts on each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..arrays import Array
from ..errors import InvalidInputError
from ..pieces.regions import Regions
from .outlines import as_plane, hull, legend_below
from .style import QUIET, colour, ground, law_name, name_of, new_figure, written

MOST_LAWS = 8  # as many as the palette has colours
MANY = 400  # regions from which on their outlines are thinner


def plot_regions(regions: Regions, path: str | Path | None = None, *, width: float | None = None,
                 dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of the regions of a law u = G_i x + g_i of one or two states.

    Two states: the regions as polygons, one outline for each pattern. Up to 8 distinct laws have a colour of the palette
    each and stand in the legend. More are told apart by the mean input on all regions of the law, one panel for each
    input: regions where an input follows the same formula have the same colour there.
    One state: the inputs themselves against it, with a dot at each kink.

    regions: what `regions` returned; path: where to write the figure, the ending chooses the format.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError for more than two states (the regions of a slice are those of the law of that slice), and when
    no region is known.

    >>> from inc_casadi import INC, Box, Plant
    >>> from inc_casadi.pieces.regions import regions
    >>> found = regions(Plant([[1.2]], [[1.0]]), INC.saturated([[-0.8]], 1.0), Box([-2.0], [2.0]))
    >>> plot_regions(found).axes[0].get_title()
    'The law in 3 regions, 3 affine laws, exact'
    """
    n = regions.simplices.shape[2]
    if n > 2:
        raise InvalidInputError(f"the law reads {n} states, but regions are drawn for one state or two only")
    if not len(regions):
        raise InvalidInputError(f"there is no region to draw: {regions.ended} ended the search")
    laws = regions.distinct_laws()
    if n == 1:
        figure = _line_figure(regions, *laws)
    elif len(laws[0]) <= MOST_LAWS:
        figure = _coloured_figure(regions, *laws)
    else:
        figure = _shaded_figure(regions, *laws)
    return written(figure, path, width, dpi)


def outlines(regions: Regions) -> list[Array]:
    """Return the corners (k, 2) of each region, counterclockwise: the hull of its simplices, since it is convex."""
    order = np.argsort(regions.which, kind="stable")
    ends = np.searchsorted(regions.which[order], np.arange(len(regions) + 1))
    return [hull(regions.simplices[order[a:b]].reshape(-1, 2)) for a, b in zip(ends[:-1], ends[1:], strict=True)]


def mean_inputs(regions: Regions, G: Array, g: Array, of: np.ndarray) -> Array:
    """Return the mean input (l, m) over all regions of each distinct law (l, m, n), (l, m); of (k,): the law of each."""
    corners = regions.simplices
    edges = corners[:, 1:] - corners[:, :1]
    weights = np.abs(np.linalg.det(edges))
    law = of[regions.which]
    volume = np.bincount(law, weights, len(G))
    center = np.stack([np.bincount(law, weights * x, len(G)) for x in corners.mean(axis=1).T], axis=1) / volume[:, None]
    return np.einsum("lmn,ln->lm", G, center) + g


def _title(regions: Regions, laws: int) -> str:
    count = f"{laws} affine law{'s' if laws > 1 else ''}"
    parts = f"{len(regions)} regions, {count}" if len(regions) > 1 else "one region"
    missing = f"\n{regions.ended} ended the search: white parts are not known" if regions.ended else ""
    return f"The law in {parts}, exact{missing}"


def _coloured_figure(regions: Regions, G: Array, g: Array, of: np.ndarray) -> Figure:
    figure = new_figure(6.4, 6.0)
    axes = figure.subplots()
    shown = outlines(regions)
    _add(axes, shown, PolyCollection(shown, facecolors=[ground(i) for i in of], edgecolors="white"))
    handles = [Patch(facecolor=ground(i), label=law_name(G[i], g[i])) for i in range(len(G))]
    legend_below(figure, handles, 3 if len(g[0]) == 1 else 2)
    axes.set_title(_title(regions, len(G)), fontsize="medium")
    return figure


def _shaded_figure(regions: Regions, G: Array, g: Array, of: np.ndarray) -> Figure:
    m = g.shape[1]
    figure = new_figure(0.6 + 5.6 * m, 5.0)
    shown, means = outlines(regions), mean_inputs(regions, G, g, of)
    for k, axes in enumerate(figure.subplots(1, m, squeeze=False)[0]):
        filled = PolyCollection(shown, cmap="viridis", edgecolors="white")
        filled.set_array(means[of, k])
        _add(axes, shown, filled)
        figure.colorbar(filled, ax=axes, label=f"mean input {name_of('u', k, m)} under each law")
    figure.suptitle(_title(regions, len(G)), fontsize="medium")
    return figure


def _add(axes: Any, shown: list[Array], filled: PolyCollection) -> None:
    filled.set_linewidth(0.8 if len(shown) <= MANY else 0.3)
    axes.add_collection(filled)
    axes.update_datalim(np.concatenate(shown))
    axes.autoscale_view()
    axes.margins(0.02)
    as_plane(axes)


def _line_figure(regions: Regions, G: Array, g: Array, of: np.ndarray) -> Figure:
    figure = new_figure(7.0, 4.8)
    axes = figure.subplots()
    m, named = g.shape[1], g.shape[1] == 1 and len(G) <= MOST_LAWS
    for region in range(len(regions)):
        x = regions.simplices[regions.which == region].reshape(-1)
        ends = np.array([x.min(), x.max()])
        for k in range(m):
            u = G[of[region], k, 0] * ends + g[of[region], k]
            axes.plot(ends, u, "-o", color=colour(of[region] if named else k), lw=2.0, ms=4, mfc="white", mec=QUIET)
    handles = [Line2D([], [], color=colour(i), lw=2, label=law_name(G[i], g[i]) if named else name_of("u", i, m))
               for i in range(len(G) if named else m)]
    if named or m > 1:
        legend_below(figure, handles)
    axes.set_xlabel("state $x$")
    axes.set_ylabel("input " + ("$u$" if m == 1 else "$u_i$"))
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
    axes.set_title(_title(regions, len(G)), fontsize="medium")
    return figure
