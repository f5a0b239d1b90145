"""The grounds of a portrait: the regions of a piecewise-affine law in a plane, each with the number of its law."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch

from ..arrays import Array
from ..inc import INC
from ..pieces.regions import Regions, regions
from ..plant import Plant
from ..sets import Box
from .plane_slice import PlaneSlice
from .regions_figure import MANY, MOST_LAWS, outlines
from .style import QUIET, colour, ground, law_name, tint

PIECES = 20_000
SMALL = 0.015  # share of the picture from which on a region bears the number of its law
EDGE, INK = "#9A9A9A", "#303030"


def regions_in(inc: INC, C: Array, plane: PlaneSlice, window: Box) -> Regions | None:
    """Return the regions of a law on a window of the plane; None unless every unit is piecewise affine."""
    if any(unit.pieces is None for unit in inc.activations):
        return None
    law, sliced = plane.law(inc, C)
    return regions(Plant(np.eye(2), np.zeros((2, inc.m)), sliced), law, window, PIECES)


def draw_regions(axes: Any, inc: INC, C: Array, plane: PlaneSlice, window: Box, busy: Array) -> list[Any]:
    """Shade the regions of a law on a window of the plane and return the handles of the legend, none for smooth laws.

    Up to 8 laws are numbered in the picture and written out in the legend, more are counted. busy (M, 2): points that
    numbers keep away from.
    """
    found = regions_in(inc, C, plane, window)
    if found is None or not len(found):
        return []
    G, g, of = found.distinct_laws()
    few = len(G) <= MOST_LAWS
    shown = outlines(found)
    shades = [ground(i, 0.6) if few else tint(colour(i), 0.12) for i in of]
    axes.add_collection(PolyCollection(shown, facecolors=shades, edgecolors=EDGE, zorder=0.5,
                                       linewidths=0.6 if len(shown) <= MANY else 0.25))
    missing = "" if not found.ended else ", not all"
    if not few:
        return [Patch(facecolor=tint(QUIET, 0.12), edgecolor=EDGE,
                      label=f"{len(found)} regions, {len(G)} laws{missing}")]
    for i, corners in enumerate(shown):
        if found.volumes[i] >= SMALL * window.volume:
            _number(axes, _quiet_place(corners, busy, window), of[i])
    whole = np.zeros((*G.shape[:2], plane.n))  # so that the formula names the coordinates by their own numbers
    whole[:, :, list(plane.axes)] = G
    names = [law_name(Gi, gi).replace("\n", ", ") for Gi, gi in zip(whole, g, strict=True)]
    return [Patch(facecolor=ground(i, 0.6), edgecolor=EDGE, label=f"{i + 1}: {name}{missing}")
            for i, name in enumerate(names)]


def _quiet_place(corners: Array, busy: Array, window: Box) -> Array:
    """The point of a convex region (N, 2), of a few, that is farthest from what is drawn (M, 2) and from corners."""
    middle = corners.mean(axis=0)
    sides = (corners + np.roll(corners, -1, axis=0)) / 2
    shares = np.array([0.0, 0.35, 0.65])[:, None, None]
    spots = (middle + shares * (np.concatenate([corners, sides]) - middle)).reshape(-1, 2)
    width = window.upper - window.lower
    others = np.concatenate([busy[np.all(np.isfinite(busy), axis=1)], corners])
    gaps = np.linalg.norm((spots[:, None] - others) / width, axis=2).min(axis=1)
    return np.asarray(spots[np.argmax(gaps)])


def _number(axes: Any, where: Array, law: int) -> None:
    axes.text(*where, str(law + 1), ha="center", va="center", fontsize="small", color=INK, zorder=6,
              bbox={"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": colour(law), "lw": 1.0})
