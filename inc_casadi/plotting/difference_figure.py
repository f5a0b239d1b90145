"""The figure of two laws compared: how far apart they are on a region, and where most."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from ..arrays import Array
from ..errors import InvalidInputError
from ..figures import at_least, at_most
from ..inc import INC
from ..mpc import MPC
from ..pieces.cover import cover, source_of
from ..pieces.critical_regions import CriticalRegions
from ..pieces.difference import Difference
from .outlines import as_plane
from .style import QUIET, WORST, colour, name_of, new_figure, written

BANDS = 41  # colours, an odd number: the middle one, white, is where the laws are alike
ROUNDING = 1e-9  # so that the largest difference itself lies within the outermost band


def plot_difference(difference: Difference, path: str | Path | None = None, *, width: float | None = None,
                    dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of two laws' difference on a region of one or two states, for the output that differs most.

    Two states: the first law less the second as colours, white where they agree to within 1/41 of the largest; lines at
    quarters of it, dashed where negative. One state: both laws and their difference against it. Both are drawn on pieces
    where they are affine, so nothing is lost between points; the star is the largest difference.

    difference: what `largest_difference` returned; path: where to write the figure.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError for more than two states, and when no piece is finished.

    >>> from inc_casadi import INC, Box
    >>> from inc_casadi.pieces.difference import largest_difference
    >>> found = largest_difference(INC.linear([[2.0]]), INC.saturated([[2.0]], 1.0), Box([-1.0], [0.75]))
    >>> plot_difference(found).axes[0].get_title()
    'The two laws differ by at most 1.000001 (star)'
    """
    n = difference.region.dimension
    if n > 2:
        raise InvalidInputError(f"the laws read {n} states, but a difference is drawn for one state or two only")
    figure = new_figure(7.2, 5.6)
    axes = figure.subplots()
    (_draw_line if n == 1 else _draw_map)(axes, difference)
    bound = f"at least {at_least(difference.value)}" if difference.ended else f"at most {at_most(difference.bound)}"
    ended = f"\n{difference.ended} ended the search" if difference.ended else ""
    axes.set_title(f"The two laws differ by {bound} (star){ended}", fontsize="medium")
    return written(figure, path, width, dpi)


def pieces_of(difference: Difference) -> tuple[Array, Array, Array]:
    """Return simplices (N, n+1, n) on which both laws are affine, and their output that differs most, (N, n+1) each.

    The region is cut again, as `largest_difference` did: pieces are not kept.
    """
    laws = [CriticalRegions(law) if isinstance(law, MPC) else law for law in (difference.first, difference.second)]
    sources = [source_of(law, difference.C) if isinstance(law, INC) else law for law in laws]
    found = cover(sources, difference.region, max(difference.pieces, 1)).finished
    if not len(found.simplices):
        raise InvalidInputError(f"no piece is finished, so there is nothing to draw: {difference.ended} ended the search")
    x, outputs = found.simplices.now, []
    for source, patterns in zip(sources, found.patterns, strict=True):
        distinct, which = source.distinct(patterns)
        parts = source.laws(distinct)
        row, constant = parts.Gx[which, difference.output], parts.g[which, difference.output]
        outputs.append(np.einsum("ski,si->sk", x, row) + constant[:, None])
    return x, outputs[0], outputs[1]


def _name(difference: Difference) -> str:
    return "output " + name_of("u", difference.output, len(difference.each))


def _draw_map(axes: Any, difference: Difference) -> None:
    x, first, second = pieces_of(difference)
    corners, most = x.reshape(-1, 2), max(difference.value, 1e-300)
    net = Triangulation(corners[:, 0], corners[:, 1], np.arange(len(corners)).reshape(-1, 3))
    edges = most * (1 + ROUNDING) * np.linspace(-1, 1, BANDS + 1)
    shown = axes.tricontourf(net, (first - second).ravel(), levels=edges, cmap="RdBu_r")
    shown.set_edgecolor("face")  # else viewers show hairlines between the bands
    steps = most * np.array([-0.75, -0.5, -0.25, 0.25, 0.5, 0.75])  # dashed where negative: the sign, without colours
    axes.tricontour(net, (first - second).ravel(), levels=steps, colors="black", linewidths=0.7,
                    linestyles=["--"] * 3 + ["-"] * 3)
    axes.figure.colorbar(shown, ax=axes, label=f"{_name(difference)}: first law less second", ticks=MaxNLocator(9))
    axes.plot(*difference.point[:, None], "*", color="white", mec=WORST, ms=14, clip_on=False, zorder=5)
    axes.use_sticky_edges = False
    axes.margins(0.04)
    as_plane(axes)


def _draw_line(axes: Any, difference: Difference) -> None:
    x, first, second = pieces_of(difference)
    order = np.argsort(x.ravel(), kind="stable")
    x, first, second = x.ravel()[order], first.ravel()[order], second.ravel()[order]
    axes.plot(x, first, color=colour(0), lw=1.8, label="first law")
    axes.plot(x, second, color=colour(1), lw=1.8, ls="--", label="second law")
    axes.fill_between(x, first - second, color=QUIET, alpha=0.25, lw=0)
    axes.plot(x, first - second, color=QUIET, lw=1.4, label="first less second")
    at = int(np.argmin(np.abs(x - difference.point[0])))
    axes.plot(x[at], first[at] - second[at], "*", color="white", mec=WORST, ms=14, clip_on=False, zorder=5)
    axes.set_xlabel("state $x$")
    axes.set_ylabel(_name(difference))
    axes.legend(fontsize="small")
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
