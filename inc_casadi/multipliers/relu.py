"""The complete quadratic multiplier of units that are linear on each half line, in its nonnegative relaxation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import he
from ..loop import ClosedLoop
from .base import Multiplier, Unknown, constant
from .sector import sector_matrix


@dataclass(frozen=True)
class Relu(Multiplier):
    """All products of the nonnegative parts of ReLU-like units, with their complementarity as an equality.

    A unit with loop.cone = (l, h), h != l, has eta = l z for z <= 0 and eta = h z for z >= 0. With the sign s of h - l,

        sigma = s (eta - l z) = |h - l| max(z, 0),      nu = s (eta - h z) = |h - l| max(-z, 0),

    so sigma >= 0, nu >= 0 and sigma nu = 0. Over k such units, with symmetric N_sigma, N_nu >= 0 entry by entry and
    N_cross >= 0 off its diagonal (its diagonal, on sigma_i nu_i = 0, is free):

        s'M s = sigma'N_sigma sigma + nu'N_nu nu + 2 sigma'N_cross nu >= 0,

    a sum of products of nonnegative numbers and of zeros: sound. A copositive matrix over (sigma, nu) would be sound
    as well; nonnegative matrices are the part of them that a linear program can search. Units with h = l obey
    eta = l z: M += He(E'Y), E s = eta - l z = 0, Y free. The other units keep their sector inequality (`Sector`),
    which is also contained for the kinked ones: there the sector product is a multiple of sigma nu.

    Refused when no unit has a cone, so for every biased loop: differences of two motions know slopes only.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]]))
    >>> [unknown.name for unknown in Relu().unknowns(loop)]
    ['N_sigma', 'N_nu', 'N_cross']
    """

    @property
    def name(self) -> str:
        """relu."""
        return "relu"

    def refusal(self, loop: ClosedLoop) -> str | None:
        """Return a sentence when no unit is linear on each half line."""
        if all(ends is None for ends in loop.cone):
            return ("the relu multiplier needs a hidden unit that is linear on each half line from the origin, and the "
                    "loop has none: its units have no cone, or biases move the equilibrium")
        return None

    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return N_sigma, N_nu, N_cross (k, k); Y (lines, n+q); Lambda, one per remaining unit."""
        bent, lines, others = units(loop)
        k, size = len(bent), loop.n + loop.q
        found = [
            Unknown("N_sigma", (k, k), "symmetric_nonnegative"), Unknown("N_nu", (k, k), "symmetric_nonnegative"),
            Unknown("N_cross", (k, k), "offdiagonal_nonnegative"), Unknown("Y", (len(lines), size), "free"),
            Unknown("Lambda", (len(others),), "nonnegative"),
        ]
        return tuple(unknown for unknown in found if 0 not in unknown.shape)

    def matrix(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return M, (n+q, n+q)."""
        bent, lines, others = units(loop)
        M = constant(loop, np.zeros((loop.n + loop.q,) * 2))
        if bent:
            sigma, nu = _parts(loop, bent)
            M = sigma.T @ values["N_sigma"] @ sigma + nu.T @ values["N_nu"] @ nu + M
            M = M + he(sigma.T @ values["N_cross"] @ nu)
        if lines:
            slope = constant(loop, np.diag(_ends(loop, lines)[:, 0]))
            M = M + he((loop.H[lines, :] - slope @ loop.Z[lines, :]).T @ values["Y"])
        if others:
            M = M + sector_matrix(loop.Z[others, :], loop.H[others, :], loop.lower[others], loop.upper[others],
                                  values["Lambda"])
        return M

    def restored(self, loop: ClosedLoop, values: Mapping[str, Any], S: Array, sizes: Array) -> dict[str, Any]:
        """Return N_ij = N~_ij / (sizes_i sizes_j), Y = diag(1 / sizes) Y~ S^{-1} and Lambda_i = Lambda~_i / sizes_i^2."""
        bent, lines, others = units(loop)
        factor = {"Y": 1.0 / sizes[lines][:, None], "Lambda": 1.0 / sizes[others] ** 2}
        factor |= dict.fromkeys(("N_sigma", "N_nu", "N_cross"), 1.0 / np.outer(sizes[bent], sizes[bent]))
        found = {name: factor[name] * value for name, value in values.items()}
        return found | ({"Y": found["Y"] @ np.linalg.inv(S)} if lines else {})


def units(loop: ClosedLoop) -> tuple[list[int], list[int], list[int]]:
    """Return the units with a kink at the origin, the linear ones, and the rest."""
    bent = [i for i, ends in enumerate(loop.cone) if ends is not None and ends[0] != ends[1]]
    lines = [i for i, ends in enumerate(loop.cone) if ends is not None and ends[0] == ends[1]]
    return bent, lines, [i for i, ends in enumerate(loop.cone) if ends is None]


def _parts(loop: ClosedLoop, bent: list[int]) -> tuple[Any, Any]:
    """Return the rows of sigma and nu over s, (k, n+q) each."""
    ends = _ends(loop, bent)
    sign = constant(loop, np.diag(np.sign(ends[:, 1] - ends[:, 0])))
    eta, z = loop.H[bent, :], loop.Z[bent, :]
    low, high = constant(loop, np.diag(ends[:, 0])), constant(loop, np.diag(ends[:, 1]))
    return sign @ (eta - low @ z), sign @ (eta - high @ z)


def _ends(loop: ClosedLoop, rows: list[int]) -> np.ndarray:
    """Return the two slopes of some units with a cone, (k, 2) floats; they are doubles in every reading of the loop."""
    return np.array([loop.cone[i] for i in rows], dtype=float)
