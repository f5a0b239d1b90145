"""The sets of a portrait: which there are, under which name, where they are drawn, and the window that holds them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from ..arrays import Array
from ..certificate import Certificate
from ..errors import DimensionError, InvalidInputError
from ..sets import Box, Ellipsoid, Polytope
from ..sets.base import Distribution
from .outlines import draw_union
from .plane_slice import PlaneSlice
from .style import WORST, colour

INITIAL, CERTIFIED = "initial set", "certified"
LOOKS = ((colour(3), (0, (5, 2))), (colour(0), "-."), (colour(4), (0, (1, 1.2))))
ROOM = 1.25  # of the half widths that hold everything


def certified_bodies(certificate: Any, sets: Mapping[str, Any] | None, initial: Distribution | None,
                     n: int) -> dict[str, Any]:
    """Return what is to be outlined by name: the initial set, what the certificate certifies, the caller's own sets.

    A certificate is asked whether it holds; a Basin of `region_of_attraction` stands for its polygons.

    A global certificate certifies no set, only values of a storage function.

    Raises InvalidInputError for a certificate that does not hold, and for a set that is no Box, Polytope or Ellipsoid;
    DimensionError for one of another dimension.
    """
    bodies: dict[str, Any] = {}
    support = None if initial is None else initial.support
    if isinstance(support, Box | Polytope | Ellipsoid):
        bodies[INITIAL] = support
    if certificate is not None:
        bodies |= _certified(certificate)
    for name, body in (sets or {}).items():
        if not isinstance(body, Box | Polytope | Ellipsoid):
            raise InvalidInputError(f"the set {name!r} is a {type(body).__name__}, but must be a Box, Polytope or Ellipsoid")
        if name in bodies:
            raise InvalidInputError(f"a set is named {name!r}, but that name is taken")
        bodies[name] = body
    for name, body in bodies.items():
        size = body.region.dimension if hasattr(body, "polytopes") else body.dimension
        if size != n:
            raise DimensionError(f"the {name} lies in R^{size}, but the plant has {n} states")
    return bodies


def _certified(certificate: Any) -> dict[str, Any]:
    if hasattr(certificate, "polytopes"):
        return {"certified by exact pieces (in floats)": certificate}
    if not isinstance(certificate, Certificate):
        raise InvalidInputError(f"certificate is a {type(certificate).__name__}, but a Certificate or a Basin is needed")
    if not certificate.holds():
        raise InvalidInputError(f"the certificate does not hold, so it certifies no set: {certificate.reason}")
    claim: Any = getattr(certificate, "claim", None)
    if hasattr(certificate, "ellipsoid"):
        return {"certified region of attraction": certificate.ellipsoid}
    if hasattr(claim, "region"):
        return {"certified invariant set": claim.region}
    support = getattr(getattr(claim, "initial", None), "support", None)
    if hasattr(certificate, "walk") and support is not None:
        return {"certified: motions from here converge": support}
    return {}  # it speaks of all states, and has level sets (`draw_levels`)


def window_of(region: Box | None, bodies: Mapping[str, Any], starts: Array | None, axes: tuple[int, ...]) -> Box:
    """Return the box (of the coordinates `axes`) to be drawn: the region, else what holds sets and starts with some room.

    Raises InvalidInputError when there is nothing to go by or the region is no Box, DimensionError when it has another
    dimension.

    >>> window_of(None, {"disc": Ellipsoid([[4.0, 0.0], [0.0, 1.0]])}, None, (0, 1)).upper.round(3).tolist()
    [0.625, 1.25]
    """
    if region is not None:
        if not isinstance(region, Box):
            raise InvalidInputError(f"region is a {type(region).__name__}, but a Box is needed")
        if region.dimension != len(axes):
            raise DimensionError(f"region lies in R^{region.dimension}, but the picture shows {len(axes)} coordinates")
        return region
    ends = [_ends(body) for body in bodies.values()] + ([] if starts is None else [starts])
    if not ends:
        raise InvalidInputError("nothing says where to look: give region, initial, starts, a certificate or sets")
    held = np.concatenate(ends, axis=1)[list(axes)]
    low, high = held.min(axis=1), held.max(axis=1)
    half = np.maximum((high - low) / 2, 1e-3 * max(float(np.max(high - low)), 1.0))
    return Box((low + high) / 2 - ROOM * half, (low + high) / 2 + ROOM * half)


def _ends(body: Any) -> Array:
    """Points (n, 2) at the ends of a set along each coordinate; of a Basin, those of its region."""
    inner = body.region if hasattr(body, "polytopes") else body
    eye = np.eye(inner.dimension)
    return np.stack([np.asarray(inner.support(eye)), -np.asarray(inner.support(-eye))], axis=1)


def draw_sets(axes: Any, plane: PlaneSlice, bodies: Mapping[str, Any]) -> list[Any]:
    """Outline each set in the plane and return the handles of the legend; one that misses the slice says so there.

    Raises InvalidInputError for a Basin in a slice of more than two states, which has no outline there.
    """
    handles, own = [], 0
    for name, body in bodies.items():
        shade, dashes = look(name, own)
        own += not name.startswith((INITIAL, CERTIFIED))
        if hasattr(body, "polytopes"):
            handles.append(_draw_basin(axes, plane, name, body))
            continue
        outline = plane.outline(body)
        if outline is None:
            handles.append(Line2D([], [], color=shade, ls=dashes, lw=2.0, label=f"{name}: misses this slice"))
            continue
        patch = Polygon(outline, closed=True, fill=False, edgecolor=shade, ls=dashes, lw=2.0, zorder=3.5, label=name)
        axes.add_patch(patch)
        handles.append(patch)
    return handles


def look(name: str, own: int) -> tuple[str, Any]:
    """Return colour and dashes of a set: initial black and dotted, certified green and solid, others in turn.

    >>> look("certified invariant set", 0)[1], look("initial set", 0)[1]
    ('-', ':')
    """
    if name == INITIAL:
        return WORST, ":"
    return (colour(2), "-") if name.startswith(CERTIFIED) else LOOKS[own % len(LOOKS)]


def _draw_basin(axes: Any, plane: PlaneSlice, name: str, basin: Any) -> Any:
    if not plane.is_whole:
        raise InvalidInputError("a Basin is drawn for two states only, in the plane of both")
    draw_union(axes, basin.polytopes(), "none", colour(2), 3.4)
    return Patch(facecolor="none", edgecolor=colour(2), lw=2.0, label=name)
