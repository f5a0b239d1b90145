"""Value iteration settled in exact arithmetic: the stored matrices are lower bounds on the cost of so many steps."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..exact import is_positive_definite
from ..integers import over_common_denominator, product
from ..plant import Plant
from ..sets import Distribution, Gaussian
from ..spec import Spec
from .exact_moments import extended_moment, is_semidefinite


def unproved_steps(plant: Plant, spec: Spec, P: Array) -> str:
    """Return "" if P_0, P_1, ... (steps + 1, n, n) are proved to be lower bounds on the cost to go, or why not.

    x'P_j x is at most the cost of the first j steps under any inputs if P_0 = 0 and, for every x and u,

        x'P_{j+1} x <= x'Q x + u'R u + beta (A x + B u)'P_j (A x + B u),

    that is [[Q + beta A'P_j A - P_{j+1}, beta A'P_j B], [., R + beta B'P_j B]] >= 0, which is decided in integers from the
    floats as they are; later steps cost nothing less than 0 if Q >= 0 and R >= 0. Rows and columns of zeros (R = 0 and
    P_0 = 0) are left out first.

    >>> from inc_casadi import Box
    >>> spec = Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1))
    >>> unproved_steps(Plant(1.0, 1.0), spec, np.array([0.0, 1.0, 1.5])[:, None, None])
    ''
    >>> unproved_steps(Plant(1.0, 1.0), spec, np.array([0.0, 1.0, 1.6])[:, None, None])
    'step 2 of value iteration is not a lower bound'
    """
    for name, weight in (("Q", spec.Q), ("R", spec.R)):
        if not _semidefinite(exact(weight)):
            return f"{name} has a negative eigenvalue, if only by rounding"
    if np.any(P[0] != 0):
        return "value iteration does not start from zero"
    if not np.all(np.isfinite(P)):
        return "value iteration did not stay finite"
    AB, scale = over_common_denominator(np.hstack([plant.A, plant.B]))
    n, m = plant.n, plant.m
    weights = np.block([[spec.Q, np.zeros((n, m))], [np.zeros((m, n)), spec.R]])
    W, of_weights = over_common_denominator(weights)
    above, below = spec.discount.as_integer_ratio()
    for j in range(len(P) - 1):
        (before, of_before), (after, of_after) = (over_common_denominator(each) for each in P[j:j + 2])
        ahead = above * product(product(AB.T, before), AB) * (of_weights * of_after)
        whole = W * (below * of_before * scale**2 * of_after) + ahead
        whole[:n, :n] -= after * (below * of_before * scale**2 * of_weights)
        if not _semidefinite(whole):
            return f"step {j + 1} of value iteration is not a lower bound"
    return ""


def _semidefinite(matrix: np.ndarray) -> bool:
    kept = np.flatnonzero(np.any(matrix != 0, axis=0))
    matrix = matrix[np.ix_(kept, kept)]
    if not kept.size or is_positive_definite(matrix):
        return True
    fractions = np.array([Fraction(entry) for entry in matrix.flat], dtype=object).reshape(matrix.shape)
    return is_semidefinite(fractions)


def second_moment(initial: Distribution) -> np.ndarray | str:
    """Return E x x' (n, n) in Fractions from the stored parameters, or why there is none.

    >>> second_moment(Gaussian([1.0], [[2.0]])).tolist()
    [[Fraction(3, 1)]]
    """
    if isinstance(initial, Gaussian):
        mean = exact(initial.mean)
        return np.outer(mean, mean) + exact(initial.covariance)
    found = extended_moment(initial)
    return found if isinstance(found, str) else found[:-1, :-1]
