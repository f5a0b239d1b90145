"""The search of sec:numerics_implicit: the least P with Lambda = lambda I, in two scalars and without a solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from inc_casadi.inequalities import Inequalities

ACCURACY = 1e-12


class Searched(NamedTuple):
    """The least P for which the LMI has a solution with Lambda = lambda I, and that lambda."""

    P: float
    lam: float

    def rounded(self, digits: int = 4) -> Searched:
        """Return both as they are printed.

        >>> Searched(1.30056, 0.77486).rounded()
        Searched(P=1.3006, lam=0.7749)
        """
        return Searched(round(self.P, digits), round(self.lam, digits))


def direct_search(inequalities: Inequalities, low: float, high: float, widest: float = 10.0) -> Searched:
    """Return the least P in [low, high] and lambda in [0, widest] with lambda_max(LMI) <= 0 at Lambda = lambda I.

    The LMI is affine in (P, lambda), so h(P) = min over lambda of lambda_max is convex: where h(low) > 0 > h(high) it has
    one root between, which is the least P. The result lies on the boundary, up to the accuracy of the search: it says
    where the LMI can be solved and certifies nothing. Scalar plant, the claim of a cost, the sector multiplier.

    Raises ValueError when h has one sign at both ends.
    """
    def least(P: float) -> tuple[float, float]:
        found = minimize_scalar(lambda lam: largest_eigenvalue(inequalities, Searched(P, lam)), bounds=(0.0, widest),
                                method="bounded", options={"xatol": ACCURACY})
        return float(found.fun), float(found.x)

    P = float(brentq(lambda P: least(P)[0], low, high, xtol=ACCURACY))
    return Searched(P, least(P)[1])


def largest_eigenvalue(inequalities: Inequalities, at: Searched) -> float:
    """Return lambda_max of the LMI, whose negative is the condition named decrease, at P and Lambda = lambda I."""
    values = {"P": np.array([[at.P]]), "Lambda": np.full(inequalities.loop.inc.q, at.lam)}
    return -float(np.linalg.eigvalsh(inequalities.conditions(values)["decrease"])[0])
