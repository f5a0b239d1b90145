"""The complete quadratic multiplier of piecewise-affine units, in its nonnegative relaxation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..blocks import diag, he
from ..errors import InvalidInputError
from ..exact_rest import LARGEST, rest_point
from ..loop import ClosedLoop
from .atoms import all_atoms, kinked_rows, parts_of
from .base import Multiplier, Unknown, constant
from .slope import slope_matrix, slope_signs, slope_unknowns

NO_REST = "a biased loop can be looked at about its equilibrium only when that is known in rational arithmetic, and "


@dataclass(frozen=True)
class Relu(Multiplier):
    """All products of the nonnegative parts of kinked units, with their complementarity as an equality.

    Each unit's z is split at its kinks into nonnegative lengths (`atoms.Atoms`); for a ReLU at rest on its kink these are
    sigma = max(z, 0) = eta and nu = max(-z, 0) = eta - z. Those that vanish at rest are h = h~, the others g = g* + g~,
    g* > 0. With

        s'M s = h'N h + 2 h'(N_g g~ - diag(w) g~_partner),

    N symmetric, N_ij >= 0 unless h_i h_j = 0 everywhere; N_g,ij >= 0 unless h_i g_j = 0 everywhere; the partner of h_i is
    a g with h_i g = 0 everywhere; and w_i g*_partner(i) >= sum_j N_g,ij g*_j:

        h_i g~_j = h_i g_j - g*_j h_i  and  h_i g~_partner = -g*_partner h_i  give
        s'M s = h'N h + 2 sum_ij N_g,ij h_i g_j + 2 sum_i h_i (w_i g*_partner(i) - sum_j N_g,ij g*_j) >= 0,

    sums of products of nonnegative numbers and of zeros: sound. It is what products with the constant 1 in the stacked
    vector (1, s) give once that row, which no strict inequality allows to be anything but zero, is eliminated. Saturation
    has two kinks and dead zones too; each kink beyond a unit's first adds a column to s. A copositive matrix over all
    parts would be sound as well; nonnegative matrices are those that can be searched.

    Straight units obey eta~ = l z~: M += He(E'Y), E s = eta~ - l z~ = 0, Y free. Curved units keep the `Slope` multiplier,
    which is contained for kinked ones: there nu'T sigma is a sum of products above.

    A biased loop is looked at about its equilibrium, found in rational arithmetic (`exact_rest.rest_point`); refused when
    there is none, or when no unit has a kink.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]]))
    >>> [unknown.name for unknown in Relu().unknowns(loop)]
    ['N']
    """

    @property
    def name(self) -> str:
        """relu."""
        return "relu"

    def refusal(self, loop: ClosedLoop) -> str | None:
        """Return a sentence when no unit has a kink, or when the equilibrium of a biased loop is not known exactly."""
        if not kinked_rows(loop):
            kinds = ", ".join(sorted({repr(unit) for unit in loop.inc.activations})) or "no hidden units"
            return f"the relu multiplier needs a hidden unit with a kink, and the loop has none ({kinds})"
        return no_rest(loop) if loop.about == "difference" and rest_point(loop.plant, loop.inc) is None else None

    def widened(self, loop: ClosedLoop) -> ClosedLoop:
        """Return the loop about its equilibrium, with a column for each kink beyond a unit's first."""
        loop = about_rest(loop)
        atoms = tuple(loop.units[row] for row, parts in all_atoms(loop) for _ in range(parts.extras))
        pad = len(atoms)
        loop = replace(loop, F=loop.padded(loop.F, pad), G=loop.padded(loop.G, pad), Z=loop.padded(loop.Z, pad),
                       X=loop.padded(loop.X, pad), H=loop.padded(loop.H, pad), atoms=atoms, parts=None)
        return replace(loop, parts=parts_of(loop))

    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return N (k, k), N_g (k, l), w (k,), Y (lines, width) and those of `Slope` for the curved units."""
        parts, lines, curved = parts_of(loop), _lines(loop), _curved(loop)
        k, l = parts.excluded_hg.shape
        alone = parts.partner < 0
        no_product = alone[:, None] | (np.arange(l)[None, :] == parts.partner[:, None])
        found = [
            Unknown("N", (k, k), "symmetric_nonnegative", unsigned=parts.excluded_hh),
            Unknown("N_g", (k, l), "nonnegative", zero=no_product, unsigned=parts.excluded_hg),
            Unknown("w", (k,), "free", zero=alone), Unknown("Y", (len(lines), loop.width), "free"),
        ]
        found = [unknown for unknown in found if 0 not in unknown.shape and unknown.free.any()]
        return (*found, *(slope_unknowns(loop, curved) if curved else ()))

    def matrix(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return M, of the loop's width."""
        parts, lines, curved = parts_of(loop), _lines(loop), _curved(loop)
        M = constant(loop, np.zeros((loop.width,) * 2))
        if "N" in values:
            M = parts.h.T @ values["N"] @ parts.h + M
        if "w" in values:
            partners = parts.g[np.maximum(parts.partner, 0), :]
            product = -diag(values["w"]) @ partners
            if "N_g" in values:
                product = values["N_g"] @ parts.g + product
            M = M + he(parts.h.T @ product)
        if lines:
            slope = constant(loop, np.diag([float(loop.inc.activations[loop.units[i]].slopes[0]) for i in lines]))
            M = M + he((loop.H[lines, :] - slope @ loop.Z[lines, :]).T @ values["Y"])
        if curved:
            M = M + slope_matrix(loop, curved, values)
        return M

    def signs(self, loop: ClosedLoop, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return w_i g*_partner(i) - sum_j N_g,ij g*_j, and the sums of `Slope`."""
        curved = _curved(loop)
        found = slope_signs(loop, curved, values) if curved else {}
        if "w" not in values:
            return found
        parts = parts_of(loop)
        paid = diag(values["w"]) @ _column(loop, parts.g_rest[np.maximum(parts.partner, 0)])
        if "N_g" in values:
            paid = paid - values["N_g"] @ _column(loop, parts.g_rest)
        partnered = np.eye(len(parts.partner))[parts.partner >= 0]
        return {"w g* - N_g g*": partnered @ paid, **found}


def no_rest(loop: ClosedLoop) -> str:
    """Return why the equilibrium of a biased loop is not known in rational arithmetic, given that it is not."""
    curved = [i for i, unit in enumerate(loop.inc.activations) if unit.pieces is None]
    if curved:
        return f"{NO_REST}hidden unit {curved[0]} is curved: {loop.inc.activations[curved[0]]}"
    if loop.n + loop.q > LARGEST:
        return f"{NO_REST}n + q = {loop.n + loop.q} is more than {LARGEST}, which takes too long"
    return f"{NO_REST}none was found"


def about_rest(loop: ClosedLoop) -> ClosedLoop:
    """Return the loop with its deviations counted from the equilibrium where biases move it."""
    if loop.about != "difference":
        return loop
    point = rest_point(loop.plant, loop.inc)
    if point is None:
        raise InvalidInputError(no_rest(loop))
    return replace(loop, about="rest", center=point.z)


def _column(loop: ClosedLoop, entries: np.ndarray) -> Any:
    return constant(loop, entries.reshape(-1, 1))


def _lines(loop: ClosedLoop) -> list[int]:
    """Return the rows of straight units."""
    kinked = set(kinked_rows(loop))
    return [row for row, unit in enumerate(loop.units)
            if row not in kinked and loop.inc.activations[unit].pieces is not None]


def _curved(loop: ClosedLoop) -> list[int]:
    """Return the rows of units that are not piecewise affine."""
    return [row for row, unit in enumerate(loop.units) if loop.inc.activations[unit].pieces is None]
