"""The level sets of a certificate's storage function in a plane of states."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from ..arrays import Array
from ..certificate import Certificate
from ..errors import InvalidInputError
from ..sets import Box
from .plane_slice import PlaneSlice
from .style import colour

SIDE = 161  # points of the grid along each axis
USUAL = 6


def levels_wanted(certificate: Any, bodies: Any, levels: int | None) -> int:
    """Return how many level sets to draw: those asked for, else some for a certificate that has no set to outline.

    Raises InvalidInputError for a number below 0, and for level sets of what has no storage function.
    """
    if levels is None:
        alone = isinstance(certificate, Certificate) and not any(name.startswith("certified") for name in bodies)
        return USUAL if alone else 0
    if int(levels) != levels or levels < 0:
        raise InvalidInputError(f"levels = {levels!r} must be a whole number, 0 or more")
    if levels and not isinstance(certificate, Certificate):
        raise InvalidInputError("level sets are those of a certificate's storage function: give certificate, one whose "
                                f"`storage` has values, not {type(certificate).__name__}")
    return int(levels)


def draw_levels(axes: Any, certificate: Any, plane: PlaneSlice, window: Box, count: int) -> list[Any]:
    """Draw level sets of V in a window of the plane and return the legend's handle; equal steps of the root of V.

    The outermost is the largest that meets the window, or `storage_level` where the proof ends there.

    Raises what `Certificate.storage` raises.
    """
    if count == 0:
        return []
    x, y, V = _values(certificate, plane, window)
    low, top = float(V.min()), min(float(V.max()), certificate.storage_level)
    if top > low:
        # the largest value is met at a point only, so without an end of the proof the levels stop short of it
        shares = np.arange(1, count + 1) / (count if top == certificate.storage_level else count + 1)
        low = max(low, 0.0)
        axes.contour(x, y, V, levels=(np.sqrt(low) + shares * (np.sqrt(top) - np.sqrt(low))) ** 2, colors=[colour(2)],
                     linewidths=0.9, zorder=2.5)
    return [Line2D([], [], color=colour(2), lw=0.9, label="level sets of the storage function $V$")]


def _values(certificate: Any, plane: PlaneSlice, window: Box) -> tuple[Array, Array, Array]:
    sides = [np.linspace(low, high, SIDE) for low, high in zip(window.lower, window.upper, strict=True)]
    points = np.stack(np.meshgrid(*sides)).reshape(2, -1)
    return sides[0], sides[1], np.asarray(certificate.storage(plane.lift(points))).reshape(SIDE, SIDE)
