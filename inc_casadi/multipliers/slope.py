"""The multiplier of repeated slope-restricted units: doubly hyperdominant, and doubly dominant where units are odd."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import diag, he
from ..loop import ClosedLoop
from .base import Multiplier, Unknown, constant


@dataclass(frozen=True)
class Slope(Multiplier):
    """Products between hidden units that share one function, from its slope range [l, h] alone.

    With sigma = eta - l z and nu = h z - eta, both of which do not decrease in z and vanish at z = 0, and

        T = diag(r) - O + E,  O, E >= 0 entry by entry with zero diagonals,  row and column sums of O + E at most r,

    O linking units of one function only and E only those whose function is odd:   s'M s = 2 nu'T sigma >= 0.

    Sound: for two units i, j of one function the pairs (sigma_i, nu_i), (sigma_j, nu_j) and (0, 0) are ordered alike, so
    by rearrangement sum_i nu_i sigma_i >= sum_i nu_i sigma_pi(i) for every permutation pi of the pairs, zeros included;
    the matrices diag(r) - O are nonnegative combinations of I - (part of a permutation) (Willems, The Analysis of
    Feedback Systems, 1971, sec. 3.5). An odd function lets any pair be replaced by its negative, which turns the signs of
    links; so |.| of the links counts (D'Amato, Rotea, Megretski, Jonsson, Automatica 37, 2001). With O = E = 0 it is the
    sector inequality of the slope range.

    Units are told to be of one function when their activations are equal, and odd when the activation says so. For a
    biased loop the deviation functions of different units differ, and links are left between one unit and itself at
    another step, when s is the deviation from an equilibrium; they are not odd then. Where a unit's sector is narrower
    than its slope range, the sector inequality is kept beside (Lambda).

    >>> from inc_casadi import INC, Plant, close_loop
    >>> import numpy as np
    >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC(np.zeros((2, 2)), [[2.0], [1.0]], [[1.0, 0.0]], [[0.0]]))
    >>> [unknown.name for unknown in Slope().unknowns(loop)]
    ['r', 'O']
    """

    @property
    def name(self) -> str:
        """slope."""
        return "slope"

    def refusal(self, loop: ClosedLoop) -> str | None:
        """Return a sentence when no two rows share a function: then the sector multiplier says the same."""
        if np.any(alike(loop, range(len(loop.units)))):
            return None
        if loop.q < 2:
            return f"the slope multiplier links hidden units of one function, and the loop has {loop.q} of them in all"
        if loop.about == "difference":
            return ("the slope multiplier links hidden units of one function, and about the equilibrium of a biased loop "
                    "(b, d or phi(0) is not 0) no two units have one")
        kinds = ", ".join(sorted({repr(unit) for unit in loop.inc.activations}))
        return f"the slope multiplier links hidden units of one function, and no two of {kinds} are one"

    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return r (k,), O (k, k), E (k, k) and Lambda, those that have entries."""
        return slope_unknowns(loop, list(range(len(loop.units))))

    def matrix(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return M, of the loop's width."""
        return slope_matrix(loop, list(range(len(loop.units))), values)

    def signs(self, loop: ClosedLoop, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return r less the row sums and r less the column sums of O + E."""
        return slope_signs(loop, list(range(len(loop.units))), values)


def alike(loop: ClosedLoop, rows: Any) -> np.ndarray:
    """Return whether two different rows of Z pass through one function of the deviation, (k, k)."""
    units = [loop.units[i] for i in rows]
    kinds = [loop.inc.activations[unit] for unit in units]
    same = np.zeros((len(units),) * 2, dtype=bool)
    for i, unit in enumerate(units):
        for j, other in enumerate(units):
            by_place = unit == other and loop.about == "rest"
            same[i, j] = i != j and (by_place or (loop.about == "origin" and kinds[i] == kinds[j]))
    return same


def slope_unknowns(loop: ClosedLoop, rows: list[int]) -> tuple[Unknown, ...]:
    """Return the unknowns of the multiplier over some rows of Z."""
    k, same = len(rows), alike(loop, rows)
    odd = np.array([loop.about == "origin" and loop.inc.activations[loop.units[i]].odd for i in rows], dtype=bool)
    odd_links = same & odd[:, None] & odd[None, :]
    found = [Unknown("r", (k,), "nonnegative")] if k else []
    if same.any():
        found.append(Unknown("O", (k, k), "nonnegative", zero=~same))
    if odd_links.any():
        found.append(Unknown("E", (k, k), "nonnegative", zero=~odd_links))
    if _narrow(loop, rows):
        found.append(Unknown("Lambda", (len(_narrow(loop, rows)),), "nonnegative"))
    return tuple(found)


def slope_matrix(loop: ClosedLoop, rows: list[int], values: Mapping[str, Any]) -> Any:
    """Return M over some rows of Z."""
    from .sector import sector_matrix
    low, high = (constant(loop, np.diag(end)) for end in _slopes(loop, rows))
    eta, z = loop.H[rows, :], loop.Z[rows, :]
    T = diag(values["r"])
    if "O" in values:
        T = T - values["O"]
    if "E" in values:
        T = T + values["E"]
    M = he((high @ z - eta).T @ T @ (eta - low @ z))
    if "Lambda" in values:
        narrow = _narrow(loop, rows)
        M = M + sector_matrix(loop.Z[narrow, :], loop.H[narrow, :], loop.lower[narrow], loop.upper[narrow],
                              values["Lambda"])
    return M


def slope_signs(loop: ClosedLoop, rows: list[int], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sums that must be nonnegative, columns (k, 1)."""
    links = [values[name] for name in ("O", "E") if name in values]
    if not links:
        return {}
    ones, r = constant(loop, np.ones((len(rows), 1))), diag(values["r"])
    by_rows = by_columns = r @ ones
    for link in links:
        by_rows, by_columns = by_rows - link @ ones, by_columns - link.T @ ones
    return {"r - row sums of O + E": by_rows, "r - column sums of O + E": by_columns}


def _slopes(loop: ClosedLoop, rows: list[int]) -> tuple[Array, Array]:
    ends = np.array([loop.inc.activations[loop.units[i]].slopes for i in rows], dtype=float).reshape(-1, 2)
    return ends[:, 0], ends[:, 1]


def _narrow(loop: ClosedLoop, rows: list[int]) -> list[int]:
    """Return the rows whose sector is narrower than the slope range."""
    activations = loop.inc.activations
    return [i for i in rows if loop.about == "origin" and activations[loop.units[i]].sector
            != activations[loop.units[i]].slopes]
