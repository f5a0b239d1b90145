"""The figure of a region of attraction: what is certified, by pieces and by ellipsoids, and what simulation shows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.tri import Triangulation
from numpy.typing import ArrayLike

from ..arrays import Array
from ..errors import DimensionError, InvalidInputError
from ..sets import Ellipsoid
from .outlines import as_plane, draw_union, hull, legend_beside, require_plane
from .plane_panels import ellipse
from .style import LIMIT, QUIET, WORST, canvas, colour, formula, tint, written

CERTIFIED = colour(2)
EDGE = "#404040"
STYLES = ("-", "--", "-.")  # ellipsoids of two methods often coincide
LINES = (colour(0), colour(1), colour(3), colour(4), colour(6))


def plot_attraction(basin: Any = None, ellipsoids: Mapping[str, Any] | None = None,
                    simulated: tuple[ArrayLike, ArrayLike] | None = None, strip: tuple[ArrayLike, float] | None = None,
                    path: str | Path | None = None, *, ax: Any = None, width: float | None = None,
                    dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of regions of attraction in the plane of two states, one over the other.

    basin: the region certified by exact pieces, what `region_of_attraction` returned, or anything with `polytopes()`,
    `region`, `equilibrium` and `share`; ellipsoids: an Ellipsoid, by the name that the legend gives it, which says whether
    it is certified, or the certificate of an Attraction, which then has to hold; simulated: sampled starting points (2, N),
    not all on a line, and which of them converge (N,), as `converging` gives them: a pale ground below the rest, with an
    edge half way between points that do and points that do not, seen where nothing else lies; strip: (v, bound), where no
    controller within its limits brings back a point with |v'x| >= bound; path: where to write the figure; ax: Matplotlib
    axes to draw into, whose figure is returned.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises DimensionError, InvalidInputError when something is not of two states, nothing is given, or a certificate does not
    hold.

    >>> from inc_casadi import Ellipsoid
    >>> figure = plot_attraction(ellipsoids={"circle": Ellipsoid([[1.0, 0.0], [0.0, 1.0]])}, strip=([0.0, 1.0], 2.0))
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['circle', 'no controller converges beyond\\n$|1\\\\,x_{2}| = 2$, outside this picture']
    """
    ellipsoids = dict(ellipsoids or {})
    if basin is None and not ellipsoids and simulated is None:
        raise InvalidInputError("there is nothing to draw: give a basin, ellipsoids or simulated points")
    shapes = {name: _shape(name, value) for name, value in ellipsoids.items()}
    figure, axes = canvas(ax, 7.0, 6.6)
    handles = _draw_simulated(axes, *simulated) if simulated is not None else []
    if basin is not None:
        handles += _draw_basin(axes, basin)
    for i, (name, ellipsoid) in enumerate(shapes.items()):
        handles.append(_draw_ellipsoid(axes, name, ellipsoid, LINES[i % len(LINES)], STYLES[i % len(STYLES)]))
    axes.margins(0.04)
    if strip is not None:
        handles.append(_draw_strip(axes, *strip))
    as_plane(axes)
    legend_beside(axes, handles, 2, ax is None)
    axes.set_title(_title(basin), fontsize="medium")
    return written(figure, path, width, dpi)


def _shape(name: str, value: Any) -> Ellipsoid:
    """The ellipsoid that is meant: itself, or that of a certificate which holds."""
    if isinstance(value, Ellipsoid):
        return value
    if not hasattr(value, "ellipsoid"):
        raise InvalidInputError(f"{name!r} is a {type(value).__name__}, but must be an Ellipsoid or its certificate")
    if not value.holds():
        raise InvalidInputError(f"the certificate {name!r} does not hold, so it has no region: {value.reason}")
    shape: Ellipsoid = value.ellipsoid
    return shape


def _title(basin: Any) -> str:
    if basin is None:
        return "Region of attraction"
    rest = ", ".join(f"{value:.3g}" for value in np.round(basin.equilibrium, 9) + 0.0)
    ended = getattr(basin, "ended", "")
    return f"Region of attraction of $x^*$ = ({rest})" + (f"\nthe search ended with {ended}" if ended else "")


def _draw_basin(axes: Any, basin: Any) -> list[Any]:
    require_plane("the basin", len(basin.equilibrium))
    around = hull(basin.region.vertices.T)
    axes.add_patch(Polygon(around, closed=True, fill=False, ec=QUIET, ls="--", lw=1.0, zorder=1.5))
    axes.update_datalim(around)
    name = f"certified by exact pieces (in floats),\n{rounded_down(basin.share)} of the region"
    polygons = basin.polytopes()
    draw_union(axes, polygons, tint(CERTIFIED, 0.45), CERTIFIED, 2.0)
    axes.plot(*np.asarray(basin.equilibrium)[:, None], "+", color=WORST, ms=9, mew=1.6, zorder=5)
    return [Patch(facecolor=tint(CERTIFIED, 0.45), edgecolor=CERTIFIED, label=name if polygons else "nothing is certified"),
            Line2D([], [], color=QUIET, ls="--", lw=1, label="region examined")]


def rounded_down(share: float) -> str:
    """Return a share in percent with two decimals, rounded down so that it claims no more than there is.

    >>> rounded_down(0.89299)
    '89.29 %'
    """
    return f"{np.floor(1e4 * share) / 100:.2f} %"


def _draw_ellipsoid(axes: Any, name: str, ellipsoid: Ellipsoid, shade: str, style: str) -> Any:
    require_plane(f"the ellipsoid {name!r}", len(ellipsoid.center))
    outline = ellipse(ellipsoid.center, ellipsoid.P, ellipsoid.level)
    line, = axes.plot(*np.column_stack([outline, outline[:, :1]]), color=shade, ls=style, lw=2.0, zorder=4, label=name)
    return line


def _draw_simulated(axes: Any, points: ArrayLike, converges: ArrayLike) -> list[Any]:
    x, good = np.asarray(points, dtype=float), np.asarray(converges, dtype=bool)
    if x.ndim != 2 or x.shape[0] != 2 or good.shape != x.shape[1:]:
        raise DimensionError(f"simulated points have shape {x.shape} and {good.shape}, but (2, N) and (N,) are needed")
    axes.update_datalim(x.T)
    axes.autoscale_view()
    ground = tint(QUIET, 0.18)
    if good.all():
        axes.add_patch(Polygon(hull(x.T), closed=True, facecolor=ground, edgecolor="none", zorder=1.0))
    elif good.any():
        net = Triangulation(*x)
        axes.tricontourf(net, good.astype(float), levels=[0.5, 1.5], colors=[ground], zorder=1.0)
        axes.tricontour(net, good.astype(float), levels=[0.5], colors=[EDGE], linewidths=0.6, zorder=1.1)
    share = f"{100 * float(good.mean()):.4g} % of {good.size} points"
    return [Patch(facecolor=ground, edgecolor=EDGE, lw=0.6, label=f"converges in simulation, {share}")]


def _draw_strip(axes: Any, v: ArrayLike, bound: float) -> Any:
    """Shade the two half-planes |v'x| >= bound as far as they lie in the picture, without widening it."""
    row = np.asarray(v, dtype=float).reshape(-1)
    require_plane("the strip", row.size)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    corners = np.array([[left, low], [right, low], [right, high], [left, high]])
    seen = False
    for sign in (-1.0, 1.0):
        beyond = _cut(corners, sign * row, bound)
        if len(beyond) > 2:
            seen = True
            axes.add_patch(Polygon(beyond, closed=True, facecolor=tint(LIMIT, 0.15), edgecolor="none", zorder=0.9))
            axes.axline(*_on_line(sign * row, bound), color=LIMIT, lw=1.4, ls="-.", zorder=3.5)
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    where = f"$|{formula(row, 0.0)}| = {bound:.4g}$" + ("" if seen else ", outside this picture")
    return Line2D([], [], color=LIMIT, lw=1.4, ls="-.", label=f"no controller converges beyond\n{where}")


def _on_line(v: Array, bound: float) -> tuple[Array, Array]:
    foot = bound * v / (v @ v)
    return foot, foot + np.array([-v[1], v[0]]) / np.linalg.norm(v)


def _cut(corners: Array, v: Array, bound: float) -> Array:
    """The part (k, 2) of a convex polygon (N, 2) where v'x >= bound.

    >>> _cut(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]), np.array([1.0, 0.0]), 1.5).tolist()
    [[1.5, 0.0], [2.0, 0.0], [2.0, 1.0], [1.5, 1.0]]
    """
    height, kept = corners @ v - bound, []
    for i in range(len(corners)):
        j = (i + 1) % len(corners)
        if height[i] >= 0:
            kept.append(corners[i])
        if (height[i] < 0) != (height[j] < 0):
            kept.append(corners[i] + (corners[j] - corners[i]) * height[i] / (height[i] - height[j]))
    return np.array(kept).reshape(-1, 2)
