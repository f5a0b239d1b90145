"""The figure of a cost-to-go: the exact discounted cost from every starting point, as a surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from ..arrays import Array
from ..errors import InvalidInputError
from ..figures import at_most
from ..regional_certificate import RegionalCertificate
from .meshes import cost_at, mesh
from .outlines import require_plane
from .style import WORST, name_of, new_figure, written

TRIANGLES = 12_000
BELOW = 0.35  # how far below the surface the contour lies, as a share of its height
LEVELS = 14


def plot_cost(certificate: RegionalCertificate, path: str | Path | None = None, *, width: float | None = None,
              dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of the discounted cost from every starting point, with its contour below; two states.

    The cost is known in closed form on every piece of the certificate's walk, and drawn at some 6000 points; the star
    is the costliest of all.

    certificate: a regional one that holds; path: where to write the figure.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError when the certificate does not hold, or for another number of states.

    >>> from inc_casadi import INC, Box, Plant, Regional, certify
    >>> claim = Regional(Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0]), [[1.0, 0.0], [0.0, 1.0]], [[0.05]], 0.98)
    >>> plant, law = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]]), INC.saturated([[-1.3749, -2.6490]], 1.0)
    >>> plot_cost(certify(plant, law, claim)).get_suptitle()
    'Discounted cost from each starting point, exact; at most 11.16813 (star)'
    """
    require_plane("the certificate's plant", certificate.plant.n)
    walk = certificate.walk
    if walk is None or certificate.reason:
        raise InvalidInputError(f"there is no cost to draw, since the certificate does not hold: {certificate.reason}")
    made = mesh(certificate.claim.initial.support, TRIANGLES)
    cost = cost_at(walk, made.nodes)
    worst, point = certificate.worst
    figure = new_figure(7.6, 5.6)
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.set_box_aspect((1.0, 1.0, 0.8), zoom=1.2)
    low, high = float(cost.min()), float(cost.max())
    floor = low - BELOW * (high - low)
    surface = _draw_surface(axes, Triangulation(made.nodes[:, 0], made.nodes[:, 1], made.triangles), cost, floor)
    axes.plot(*point[:, None], [worst], "*", color="white", mec=WORST, ms=14, zorder=5)
    axes.plot(*point[:, None], [floor], "*", color="white", mec=WORST, ms=9, zorder=2)
    axes.set_zlim(floor, max(worst, high))
    axes.set_zticks([tick for tick in axes.get_zticks() if low - 0.02 * (high - low) <= tick <= max(worst, high)])
    axes.locator_params(axis="x", nbins=5)
    axes.locator_params(axis="y", nbins=5)
    axes.set_xlabel("starting point " + name_of("x", 0, 2))
    axes.set_ylabel("starting point " + name_of("x", 1, 2))
    axes.view_init(elev=24, azim=-52)
    ticks = low + (high - low) * np.linspace(0.0, 1.0, 6) ** 2  # as the colours go
    bar = figure.colorbar(surface, ax=axes, label="discounted cost from $x_0$", shrink=0.7, pad=0.1)
    bar.set_ticks(list(ticks), labels=[f"{tick:.3g}" if tick > 0.01 * high else "0" for tick in ticks])
    figure.suptitle(f"Discounted cost from each starting point, exact; at most {at_most(certificate.worst_bound)} (star)",
                    fontsize="medium")
    return written(figure, path, width, dpi)


def _draw_surface(axes: Any, net: Triangulation, cost: Array, floor: float) -> Any:
    """Draw the surface, and its contour on the floor. Colours go with the root of the cost, as distances do."""
    low, high = float(cost.min()), float(cost.max())
    scale = PowerNorm(0.5, low, high)
    levels = low + (high - low) * np.linspace(0.0, 1.0, LEVELS + 1) ** 2
    ground = axes.tricontourf(net, cost, levels=levels, norm=scale, zdir="z", offset=floor, cmap="viridis", zorder=1)
    ground.set_edgecolor("face")  # else viewers show hairlines between the bands
    surface = axes.plot_trisurf(net, cost, cmap="viridis", norm=scale, linewidth=0.3, zorder=3)
    surface.set_edgecolor("face")
    return surface
