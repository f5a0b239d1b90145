"""The paper's diagonal sector multiplier."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..blocks import diag, he
from ..loop import ClosedLoop
from .base import Multiplier, Unknown


@dataclass(frozen=True)
class Sector(Multiplier):
    """M_Lambda of eq:M_lambda: one nonnegative weight per hidden unit on its sector inequality.

    M_Lambda = -2 Z'D0 Lambda D1 Z + He(H'Lambda (D0 + D1) Z) - 2 H'Lambda H.

    Sound: s'M_Lambda s = 2 (eta - D0 z)'Lambda (D1 z - eta) is twice the sum of Lambda_i (eta_i - D0_i z_i)
    (D1_i z_i - eta_i), and every product is >= 0 by Assumption ass:sector when eta = phi(z) (eq:iqc_nonnegative), or by
    Assumption ass:incremental_sector when s is a difference of two motions. Applies to every loop.

    >>> import numpy as np
    >>> from inc_casadi import INC, Plant, close_loop
    >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]]))
    >>> Sector().matrix(loop, {"Lambda": np.ones(1)}).tolist()
    [[0.0, 2.0], [2.0, -2.0]]
    """

    @property
    def name(self) -> str:
        """sector."""
        return "sector"

    def refusal(self, loop: ClosedLoop) -> str | None:
        """Return None: every activation states a sector or a slope range."""
        return None

    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return Lambda, one nonnegative number per row of Z."""
        return (Unknown("Lambda", (len(loop.units),), "nonnegative"),)

    def matrix(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return M_Lambda, of the loop's width."""
        return sector_matrix(loop.Z, loop.H, loop.lower, loop.upper, values["Lambda"])


def sector_matrix(Z: Any, H: Any, lower: Any, upper: Any, weights: Any) -> Any:
    """Return M_Lambda for some of the units: Z, H (k, n+q), sector ends and weights (k,); 2 is an integer for Fractions."""
    D0, D1, Lambda = diag(lower), diag(upper), diag(weights)
    return -2 * (Z.T @ D0 @ Lambda @ D1 @ Z) + he(H.T @ Lambda @ (D0 + D1) @ Z) - 2 * (H.T @ Lambda @ H)
