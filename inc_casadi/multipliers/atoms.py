"""The nonnegative parts of a piecewise-affine unit: how far its pre-activation has got past each kink, on either side."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..activations import Activation
from ..loop import ClosedLoop
from .base import constant

Numbers = np.ndarray


@dataclass(frozen=True, eq=False)
class Atoms:
    """Nonnegative functions of one unit's z, as rows over (z~, eta~, a_1, ..., a_{r-1}), with their values at rest.

    For kinks k_1 < ... < k_r, slopes s_0, ..., s_r, the length of z beyond them is split into

        p = max(z - k_r, 0),  n = max(k_1 - z, 0),  a_j = clamp(z - k_j, 0, k_{j+1} - k_j),  b_j = k_{j+1} - k_j - a_j.

    With up_j = a_j (j < r), up_r = p and down_1 = n, down_j = b_{j-1} (j > 1): up_j > 0 needs z > k_j, down_j > 0 needs
    z < k_j. So all of them are >= 0, and up_j down_i = 0 for i <= j. They are linear in three kinds of numbers, because

        z = k_1 - n + sum a_j + p,     eta = phi(k_1) - s_0 n + sum s_j a_j + s_r p,

    two equations for r + 1 lengths: r - 1 of them are further variables, and the two with the slopes that differ most
    follow. All in deviations ~ from the value at rest.

    rows: (2r, 2 + r - 1) Fractions, up_1..up_r then down_1..down_r; at_rest: (2r,) Fractions; kinks: r.
    """

    rows: Numbers
    at_rest: Numbers
    kinks: int

    @property
    def extras(self) -> int:
        """Number of further variables, r - 1."""
        return self.kinks - 1


def bends(activation: Activation) -> tuple[list[Fraction], list[Fraction]] | None:
    """Return kinks where the slope changes and the slopes between them, exactly, or None for a curved unit."""
    pieces = activation.pieces
    if pieces is None:
        return None
    slopes = [Fraction(float(slope)) for slope in pieces.slopes]
    kept = [j for j in range(len(pieces.kinks)) if slopes[j] != slopes[j + 1]]
    return [Fraction(float(pieces.kinks[j])) for j in kept], [slopes[0], *(slopes[j + 1] for j in kept)]


def atoms_of(activation: Activation, rest: Fraction) -> Atoms | None:
    """Return the parts of a unit whose pre-activation is `rest` at the center, or None without a kink.

    >>> from inc_casadi.activations import ReLU
    >>> parts = atoms_of(ReLU(), Fraction(0))
    >>> [[str(entry) for entry in row] for row in parts.rows]   # p = eta~, n = eta~ - z~
    [['0', '1'], ['-1', '1']]
    """
    found = bends(activation)
    if found is None or not found[0]:
        return None
    kinks, slopes = found
    r = len(kinks)
    # Lengths in the order n, a_1, ..., a_{r-1}, p with slopes s_0, ..., s_r; n and the steepest difference are solved for.
    other = max(range(1, r + 1), key=lambda j: abs(slopes[j] - slopes[0]))
    extras = [j for j in range(1, r + 1) if j != other]
    lengths = np.full((r + 1, 2 + r - 1), Fraction(0), dtype=object)
    for column, j in enumerate(extras):
        lengths[j, 2 + column] = Fraction(1)
    z_left, eta_left = (np.full(2 + r - 1, Fraction(0), dtype=object) for _ in range(2))
    z_left[0] = eta_left[1] = Fraction(1)
    for column, j in enumerate(extras):
        z_left[2 + column], eta_left[2 + column] = Fraction(-1), -slopes[j]
    gap = slopes[other] - slopes[0]
    lengths[0] = (eta_left - slopes[other] * z_left) / gap
    lengths[other] = (eta_left - slopes[0] * z_left) / gap
    up, down = [lengths[j] for j in range(1, r + 1)], [lengths[0], *(-lengths[j] for j in range(1, r))]
    values = [_clamped(rest - kinks[j], kinks[j + 1] - kinks[j] if j + 1 < r else None) for j in range(r)]
    opposite = [_clamped(kinks[0] - rest, None), *(kinks[j + 1] - kinks[j] - values[j] for j in range(r - 1))]
    return Atoms(np.array([*up, *down], dtype=object), np.array([*values, *opposite], dtype=object), r)


def _clamped(value: Fraction, top: Fraction | None) -> Fraction:
    value = max(value, Fraction(0))
    return value if top is None else min(value, top)


@dataclass(frozen=True, eq=False)
class Parts:
    """The nonnegative parts of all kinked units of a loop: rows over s, and what is known of their products.

    zero: those that vanish at rest, h; beyond: those that do not, g. h (k, N), g (l, N): rows over s of their deviations.
    g_rest: (l,) Fractions, values of g at rest. excluded_hh (k, k), excluded_hg (k, l): True where the product is zero
    everywhere. partner: (k,) for each h the index of a g with h g = 0 everywhere, or -1.
    """

    h: Any
    g: Any
    g_rest: Numbers
    excluded_hh: np.ndarray
    excluded_hg: np.ndarray
    partner: np.ndarray


def kinked_rows(loop: ClosedLoop) -> list[int]:
    """Return the rows of Z that pass through a unit with a kink."""
    kinked = {unit: bool((bends(unit) or ([], []))[0]) for unit in set(loop.inc.activations)}
    return [row for row, unit in enumerate(loop.units) if kinked[loop.inc.activations[unit]]]


def all_atoms(loop: ClosedLoop) -> list[tuple[int, Atoms]]:
    """Return the kinked rows with their atoms."""
    rest = [Fraction(0)] * loop.q if loop.center is None else loop.center
    kinds = {unit: (loop.inc.activations[unit], rest[unit]) for unit in set(loop.units)}
    found = {kind: atoms_of(*kind) for kind in set(kinds.values())}
    return [(row, parts) for row, unit in enumerate(loop.units) if (parts := found[kinds[unit]]) is not None]


def parts_of(loop: ClosedLoop) -> Parts:
    """Return the parts over the stack of a loop that the relu multiplier has widened, formed once."""
    if loop.parts is not None:
        return loop.parts
    atoms = all_atoms(loop)
    count = sum(2 * parts.kinks for _, parts in atoms)
    over_z, over_eta = (np.full((count, len(loop.units)), Fraction(0), dtype=object) for _ in range(2))
    over_extra = np.full((count, max(len(loop.atoms), 1)), Fraction(0), dtype=object)
    place = extra = 0
    owner: list[tuple[int, int, Atoms]] = []
    for row, parts in atoms:
        block = slice(place, place + 2 * parts.kinks)
        over_z[block, row], over_eta[block, row] = parts.rows[:, 0], parts.rows[:, 1]
        over_extra[block, extra: extra + parts.extras] = parts.rows[:, 2:]
        owner += [(row, k, parts) for k in range(2 * parts.kinks)]
        place, extra = place + 2 * parts.kinks, extra + parts.extras
    columns = np.eye(loop.width)[loop.width - len(loop.atoms):] if loop.atoms else np.zeros((1, loop.width))
    at_rest = np.array([parts.at_rest[k] for _, k, parts in owner], dtype=object)
    is_zero = np.array([value == 0 for value in at_rest], dtype=bool)
    zero, beyond = np.flatnonzero(is_zero), np.flatnonzero(~is_zero)

    def rows(chosen: np.ndarray) -> Any:
        return (constant(loop, over_z[chosen]) @ loop.Z + constant(loop, over_eta[chosen]) @ loop.H
                + constant(loop, over_extra[chosen]) @ columns)

    vanish = _vanishing(owner)
    hg = vanish[np.ix_(zero, beyond)]
    partner = np.where(hg.any(axis=1), hg.argmax(axis=1), -1) if hg.size else np.full(len(zero), -1)
    return Parts(rows(zero), rows(beyond), at_rest[beyond], vanish[np.ix_(zero, zero)], hg, partner)


def _vanishing(owner: list[tuple[int, int, Atoms]]) -> np.ndarray:
    """Return whether the product of each two functions is zero everywhere: up_j down_i of one unit with i <= j."""
    row = np.array([row for row, _, _ in owner], dtype=int)
    up = np.array([k < parts.kinks for _, k, parts in owner], dtype=bool)
    level = np.array([k % parts.kinks for _, k, parts in owner], dtype=int)
    zero = (row[:, None] == row) & up[:, None] & ~up & (level <= level[:, None])
    return zero | zero.T
