"""Two lines between which each hidden unit stays: around the rest, near it one of them is the unit itself."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..activations import Activation
from ..blocks import exact
from ..multipliers.atoms import bends
from .base import Setting, within

Numbers = np.ndarray


@dataclass(frozen=True, eq=False)
class Lines:
    """For each unit eta~ lies between near z~ and far z~ + bend h, for every number h with |h| <= room.

    Let a piecewise-affine unit have slope s1 around its rest z*, slope s0 on all its other pieces, and no kink within `room`
    of z*. Then eta~ = s0 z~ + (s1 - s0) c(z~), where c clips z~ to an interval that contains [-room, room]. If c(z~) = z~,
    then eta~ = s1 z~; otherwise c(z~) is the end of the interval that z~ is beyond, which lies between z~ and every h
    inside. In both cases c(z~) lies between z~ and h, so eta~ lies between s1 z~ and s0 z~ + (s1 - s0) h: near = s1, far =
    s0, bend = s1 - s0. For a saturation this is the fact behind both Hu and Lin's convex hull and the generalized sector
    condition of Gomes da Silva and Tarbouriech (h = H e, |H e| <= room on the ellipsoid); it is as true of ReLU and leaky
    ReLU units.

    Any other unit, and one that rests on a kink, lies between its global bounds D1 z~ and D0 z~: bend = 0, and h has no
    part.

    near, far, bend: (q,) Fractions; room: (q,) Fractions, zero where bend is.
    """

    near: Numbers
    far: Numbers
    bend: Numbers
    room: Numbers

    @property
    def bent(self) -> list[int]:
        """The units that take part with an h."""
        return [i for i in range(len(self.bend)) if self.bend[i] != 0]


def lines(setting: Setting) -> Lines:
    """Return the lines of all units about the rest of a setting.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> found = lines(Setting(loop, Attraction(), rest_of(loop)))
    >>> [str(numbers[0]) for numbers in (found.near, found.far, found.bend, found.room)]
    ['1', '0', '1', '1']
    """
    loop, rest = setting.loop, setting.rest
    lower, upper = _ends(setting)
    rows = []
    for i, unit in enumerate(loop.inc.activations):
        found = _bent(unit, rest.z_low[i], rest.z_high[i])
        rows.append(found or (upper[i], lower[i], Fraction(0), Fraction(0)))
    columns = np.array(rows, dtype=object).reshape(-1, 4).T
    return Lines(*columns)


def _ends(setting: Setting) -> tuple[Numbers, Numbers]:
    """The stated global bounds on eta~ / z~, whatever arithmetic the loop is read in."""
    from ..activations.stack import sectors, slopes
    units = setting.loop.inc.activations
    ends = sectors(units) if setting.loop.about == "origin" else slopes(units)
    assert ends is not None
    return exact(ends[0]), exact(ends[1])


def _bent(unit: Activation, low: Fraction, high: Fraction) -> tuple[Fraction, Fraction, Fraction, Fraction] | None:
    """Return near, far, bend and room of a unit with two slopes that rests inside a piece, or None."""
    found = bends(unit)
    if found is None or not found[0]:
        return None
    kinks, slopes = found
    j = sum(low > kink for kink in kinks)
    others = set(slopes[:j] + slopes[j + 1:])
    if len(others) != 1 or any(low <= kink <= high for kink in kinks):
        return None
    far = others.pop()
    return slopes[j], far, slopes[j] - far, min(min(abs(kink - low), abs(kink - high)) for kink in kinks)


def keeps_room(setting: Setting, found: Lines, P: Any, H: Any) -> dict[str, Any]:
    """Return the conditions that |H_i e| < room_i wherever e'P e <= 1, one for each bent unit; H (q, n)."""
    eye = np.eye(setting.loop.n)
    conditions: dict[str, Any] = {}
    for i in found.bent:
        conditions |= within(setting, f"room of unit {i}", P, eye, H[i: i + 1, :], found.room[i])
    return conditions


def diagonal(setting: Setting, entries: Numbers) -> Any:
    """Return Fractions (q,) as a diagonal matrix in the arithmetic of the setting."""
    square = np.full((len(entries),) * 2, Fraction(0), dtype=object)
    np.fill_diagonal(square, entries)
    return setting.number(square) if len(entries) else setting.number(np.zeros((0, 0)))
