"""Boxes of gains cut by half-spaces, and how much of each box they leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .moves import UNIT


@dataclass(frozen=True, eq=False)
class HalfSpaces:
    """For each of N boxes of gains, centre and half-widths (N, d): rows (N, k, d) delta <= room (N, k)."""

    centers: Array
    widths: Array
    rows: Array
    room: Array


def narrowed(half: HalfSpaces) -> tuple[HalfSpaces, np.ndarray]:
    """Return the boxes shrunk to what the half-spaces leave of them, and which are empty.

    a_i delta_i <= room - min over the box of sum_{j != i} a_j delta_j, twice, rounded outward; so that no width becomes
    zero, at least 1e-9 of it is kept.
    """
    centers, widths, rows, room = half.centers, half.widths, half.rows, half.room
    empty: np.ndarray = np.zeros(len(centers), dtype=bool)
    for _ in range(2 if room.shape[1] else 0):
        least = np.abs(rows) * widths[:, None]
        left = (room + np.sum(least, axis=2))[..., None] - least
        empty |= np.any(room + np.sum(least, axis=2) < 0, axis=1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ends = left / rows
        high = np.minimum(widths, np.min(np.where(rows > 0, ends, np.inf), axis=1))
        low = np.maximum(-widths, np.max(np.where(rows < 0, ends, -np.inf), axis=1))
        middle = np.clip((high + low) / 2, -widths, widths)
        half_width = np.maximum((high - low) / 2, 0) * (1 + 1e-9) + 1e-9 * widths + 8 * UNIT * np.abs(centers)
        empty |= np.any(high < low - 1e-9 * widths, axis=1)
        centers, widths = centers + middle, half_width
        room = room - np.einsum("Nkd,Nd->Nk", rows, middle)
    return HalfSpaces(centers, widths, rows, room), empty
