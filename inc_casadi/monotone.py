"""Well-posedness by a matrix inequality: a diagonal T that makes the fixed-point equation strongly monotone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from . import exact
from .arrays import Array
from .brief import Brief
from .lmi_problem import Block, Problem, Term
from .readings import Rational, Rounded

Slopes = tuple[Array, Array]
"""The units' smallest and largest slopes, L (q,) and S (q,): the diagonals of Assumption ass:incremental_sector."""

KEPT = 0.99  # share of the computed monotonicity that is claimed, so that rounding cannot refuse what is well inside


@dataclass(frozen=True, eq=False)
class Multiplier(Brief):
    """A diagonal T > 0 with He((I - LW)'T(I - SW)) >= 2 monotonicity T; T (q,), monotonicity > 0."""

    T: Array
    monotonicity: float


def condition(slopes: Slopes, W: Any, T: Any) -> Any:
    """Return He((I - LW)'T(I - SW)), which is 2T - TSW - W'ST when L = 0; (q, q).

    W and T are floats or a reading of them. Let x = eta1 - eta2 be the difference of two solutions for the same c. Then
    (x - LWx)'T(x - SWx) <= 0, as each unit's slope lies between its two, while the condition makes this quadratic form
    positive: so x = 0. For the same reason I - DW is nonsingular for every diagonal D between L and S.

    A solution exists too. With phi(z) = Lz + psi(z), v = psi(z), A = I - LW and G = S - L, the equation becomes
    v = psi(W A^{-1} v + c') and the condition He(T (I - G W A^{-1})) > 0. Since the slopes of psi lie within [0, G], it is
    a resolvent: 0 in (I - G W A^{-1}) v - G c' + df(v) with a separable convex f. In the inner product x'Ty the first part
    is strongly monotone and df maximal monotone, so there is exactly one zero for every c.
    (Revay, Wang, Manchester 2020, Lipschitz bounded equilibrium networks; Winston, Kolter 2020, Monotone operator
    equilibrium networks; both for L = 0.)

    >>> condition((np.zeros(1), np.ones(1)), np.array([[-3.0]]), np.ones(1)).tolist()
    [[8.0]]
    """
    low, high = slopes
    A, B = np.eye(low.size) - low[:, None] * W, np.eye(low.size) - high[:, None] * W
    half = A.T @ (T[:, None] * B)
    return half + half.T


def lmi_well_posed(slopes: Slopes, W: Array, T: Array, exactly: bool, monotonicity: float = 0.0) -> bool:
    """Return whether T > 0 and He((I - LW)'T(I - SW)) > 2 monotonicity T hold, decided from the stored numbers.

    exactly: in rational arithmetic, where False means that it does not hold; else in floats with every rounding bounded,
    where False may also mean that rounding leaves it open. With monotonicity = 0 this is well-posedness itself.

    >>> relu = np.zeros(2), np.ones(2)
    >>> [lmi_well_posed(relu, np.array([[-3.0, 1.0], [-1.0, -3.0]]), np.ones(2), exactly) for exactly in (True, False)]
    [True, True]
    >>> lmi_well_posed((np.zeros(1), np.ones(1)), np.array([[1.0]]), np.ones(1), True)
    False
    """
    if not (np.all(np.isfinite(T)) and np.all(T > 0) and np.isfinite(monotonicity) and monotonicity >= 0):
        return False
    if T.size == 0:
        return True
    kind = Rational if exactly else Rounded
    gap = condition(slopes, kind.lift(W), kind.lift(T)) - kind.lift(np.diag(T)) * (2.0 * monotonicity)
    return exact.is_positive_definite(gap.numbers) if exactly else _surely_positive(gap)


def find_multiplier(slopes: Slopes, W: Array) -> Multiplier | None:
    """Return a verified T, or None when none was found; sufficient for well-posedness, not necessary.

    A few scalings are tried at no cost. Then the semidefinite program: maximize t over 0 <= T <= 1 with
    D He((I - LW)'(D^{-1}TD^{-1})(I - SW)) D >= t I, D the units' largest slopes. Nothing is taken from the solver on trust:
    `lmi_well_posed` decides in floats with every rounding bounded.

    W (q, q). Raises SolverError when the solver is missing.

    >>> find_multiplier((np.zeros(1), np.ones(1)), np.array([[-3.0]])).monotonicity
    3.96
    >>> find_multiplier((np.zeros(1), np.ones(1)), np.array([[2.0]])) is None
    True
    """
    if W.size == 0:
        return Multiplier(np.ones(0), 1.0)
    if not np.all(np.isfinite(slopes)) or _is_hopeless(slopes, W):
        return None
    for T in chain(_simple_scalings(slopes, W), _searched(slopes, W)):
        claimed = KEPT * _monotonicity(slopes, W, T)
        if claimed > 0 and lmi_well_posed(slopes, W, T, False, claimed):
            return Multiplier(T, claimed)
    return None


def lipschitz_bounds(slopes: Slopes, W: Array, U: Array, V: Array, K: Array, T: Array) -> tuple[Array, Array]:
    """Return bounds (q, p) on |d eta / dy| and (m, p) on |du/dy|, entrywise, from the strong monotonicity.

    If y changes by e_j and eta by x, z changes by W x + w with w = U e_j, and (x - L(Wx + w))'T(S(Wx + w) - x) >= 0. So x
    lies in the ellipsoid x'Hx - 2x'k + w'LTSw <= 0, where H = He(A'TB)/2, k = (A'TS + B'TL) w / 2, A = I - LW, B = I - SW.
    On it r'x is within sqrt(r'H^{-1}r (k'H^{-1}k - w'LTSw)) of r'H^{-1}k. Changes of several coordinates of y add up.

    U (q, p), V (m, q), K (m, p); T (q,), for which the condition holds.

    >>> eye = np.eye(1)
    >>> hidden, outer = lipschitz_bounds((np.zeros(1), np.ones(1)), -3.0 * eye, eye, eye, eye, np.ones(1))
    >>> hidden.tolist(), outer.tolist()  # eta has slopes between 0 and 1/4
    ([[0.25]], [[1.25]])
    """
    low, high = slopes
    A, B = np.eye(low.size) - low[:, None] * W, np.eye(low.size) - high[:, None] * W
    H = condition(slopes, W, T) / 2
    k = (A.T @ ((T * high)[:, None] * U) + B.T @ ((T * low)[:, None] * U)) / 2
    center, spread = np.linalg.solve(H, k), np.linalg.inv(H)
    room = np.maximum(np.sum(k * center, axis=0) - np.sum(U * ((low * T * high)[:, None] * U), axis=0), 0.0)
    hidden = np.abs(center) + np.sqrt(np.outer(np.diag(spread), room))
    hidden[(low == 0) & (high == 0)] = 0.0  # a constant unit does not move
    return hidden, np.abs(K + V @ center) + np.sqrt(np.outer(np.einsum("ij,jk,ik->i", V, spread, V), room))


def error_from_residual(slopes: Slopes, W: Array, multiplier: Multiplier, residual: Array) -> Array:
    """Return e (q,) with |eta^ - eta| <= e for every eta^ with |eta^ - phi(W eta^ + c)| <= residual, eta the solution.

    With x = eta^ - eta and the residual r: (Ax - r)'T(Bx - r) <= 0, A = I - LW, B = I - SW, so
    monotonicity x'Tx <= x'(A + B)'Tr, and |A + B| <= 2I + |(L + S)W| gives a bound on |x|_T, hence on each |x_i|. All of it
    sums of nonnegative numbers: in floats it is off by far less than 1e-6 of itself.

    >>> relu = np.zeros(1), np.ones(1)
    >>> error_from_residual(relu, np.array([[-3.0]]), Multiplier(np.ones(1), 4.0), np.array([0.4])).round(12).tolist()
    [0.5]
    """
    T = multiplier.T
    reach = 2.0 * np.eye(T.size) + np.abs((slopes[0] + slopes[1])[:, None] * W)
    size = np.sqrt(np.sum((reach.T @ (T * residual)) ** 2 / T)) / multiplier.monotonicity
    return size / np.sqrt(T)


def _surely_positive(gap: Rounded) -> bool:
    from .definite import is_surely_positive
    return is_surely_positive(gap)


def _monotonicity(slopes: Slopes, W: Array, T: Array) -> float:
    """The largest number with He(A'TB) >= 2 number T, computed in floats; -inf when T is of no use."""
    if not (np.all(np.isfinite(T)) and np.all(T > 0)):
        return -np.inf
    scale = np.sqrt(T)
    return float(np.linalg.eigvalsh(condition(slopes, W, T) / np.outer(scale, scale))[0]) / 2


def _is_hopeless(slopes: Slopes, W: Array) -> bool:
    """Whether some I - DW is singular, as far as a few determinants tell: then there is no T and none is searched."""
    low, high = slopes
    own = np.diag(W)
    if np.any((1.0 - low * own) * (1.0 - high * own) <= 0):
        return True
    signs = {float(np.linalg.slogdet(np.eye(low.size) - D[:, None] * W)[0]) for D in (low, (low + high) / 2, high)}
    return len(signs) > 1 or 0.0 in signs


def _simple_scalings(slopes: Slopes, W: Array) -> Iterator[Array]:
    """T = S^{-1}, T = S^{-2}, and T = u / v with the left and right Perron vectors u, v of S|W|, made positive.

    The first suits a symmetric I - W > 0; the last always does when lambda_pf(S|W|) < 1 and L = 0.
    """
    size = _sizes(slopes)
    M = np.maximum(*np.abs(slopes))[:, None] * np.abs(W)
    radius = float(np.max(np.abs(np.linalg.eigvals(M)), initial=0.0))
    level = 0.5 * (1.0 + radius) if radius < 1 else 1.5 * radius
    yield 1.0 / size
    yield size**-2
    system, ones = level * np.eye(size.size) - M, np.ones(size.size)
    ratio = np.linalg.solve(system.T, ones) / np.linalg.solve(system, ones)
    yield ratio / ratio.max()


def _sizes(slopes: Slopes) -> Array:
    """The units' largest absolute slopes, 1 for a constant unit."""
    size = np.maximum(*np.abs(slopes))
    return np.where(size > 0, size, 1.0)


def _searched(slopes: Slopes, W: Array) -> Iterator[Array]:
    """The T that the semidefinite program ends with, then its deeper point; not yet verified."""
    from .interior_point import solve
    size = _sizes(slopes)
    found = solve(search_problem(slopes, W))
    for y in (found.y, found.interior):
        if y is not None and np.all(np.isfinite(y)):
            yield y[:-1] / size**2


def search_problem(slopes: Slopes, W: Array) -> Problem:
    """Return the program: maximize t over y = (T', t), 0 <= T' <= 1, D He(A'(D^{-1}T'D^{-1})B) D >= t I.

    D holds the units' largest slopes, A = I - LW and B = I - SW. In x = D^{-1} eta every unit has slopes within [-1, 1] of a
    z in its own scale. A T exists exactly when the optimum is positive, because the condition is homogeneous in T.

    >>> problem = search_problem((np.zeros(1), np.ones(1)), np.array([[-3.0]]))
    >>> problem.violation(np.array([0.5, 3.0])) < 0 < problem.violation(np.array([0.5, 5.0]))
    True
    """
    (low, high), q, size = slopes, W.shape[0], _sizes(slopes)
    scaled = W * size[None, :] / size[:, None]
    A, B = np.eye(q) - low[:, None] * scaled, np.eye(q) - high[:, None] * scaled
    own = np.where(np.eye(q, dtype=bool), np.arange(q)[:, None], -1)
    shared = np.where(np.eye(q, dtype=bool), q, -1)
    block = Block(np.zeros((q, q)), (Term(own, 2.0 * A.T, B.T), Term(shared, -np.eye(q), np.eye(q))))
    return Problem(np.append(np.zeros(q), -1.0), (block,), np.zeros((0, q + 1)), np.zeros(0),
                   np.append(np.zeros(q), -np.inf), np.append(np.ones(q), np.inf))
