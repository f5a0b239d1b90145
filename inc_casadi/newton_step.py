"""One predictor-corrector step of an interior-point method for semidefinite programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .arrays import Array
from .cone_program import ConeProgram, Point

RIDGES = (1e-14, 1e-12, 1e-10, 1e-8)  # added to the unit diagonal of the scaled equations until they can be factored
REFINEMENTS = 3
SMALL = 1e-6  # mean complementarity below which the centering exponent is fixed


@dataclass(frozen=True, eq=False)
class Iterate:
    """y: (v,); S and X: points strictly inside the cone; exact: whether S is the slack at y (else an infeasible start)."""

    y: Array
    S: Point
    X: Point
    exact: bool


def inner(X: Point, S: Point) -> float:
    """Return the inner product <X, S>: the sum of tr(X_k S_k).

    >>> inner((np.eye(2), np.ones(1)), (3 * np.eye(2), np.full(1, 4.0)))
    10.0
    """
    return float(sum(np.vdot(x, s) for x, s in zip(X, S, strict=True)))


def inside(S: Point) -> bool:
    """Return whether S is strictly inside the cone: its Cholesky factorizations succeed.

    >>> inside((np.eye(2), np.ones(1))), inside((np.eye(2), np.zeros(1)))
    (True, False)
    """
    try:
        roots(S)
    except np.linalg.LinAlgError:
        return False
    return True


def roots(S: Point) -> Point:
    """Return the inverses L^-1 of the Cholesky factors, S = L L', and 1 / sqrt(s) of the linear part.

    Raises LinAlgError when S is not strictly inside the cone.

    >>> roots((np.array([[4.0]]), np.array([16.0])))
    (array([[0.5]]), array([0.25]))
    """
    from scipy.linalg.lapack import dpotrf, dtrtri

    inverses = []
    for block in S[:-1]:
        L, failed = dpotrf(block, lower=1, clean=1) if block.size else (block, 0)
        inverse, singular = dtrtri(L, lower=1) if block.size else (block, 0)
        if failed or singular or not np.all(np.isfinite(inverse)):
            raise np.linalg.LinAlgError("a block of the slack is not positive definite")
        inverses.append(inverse)
    if not np.all((S[-1] > 0.0) & np.isfinite(S[-1])):
        raise np.linalg.LinAlgError(f"a linear constraint has the slack {np.min(S[-1]):g}")
    return (*inverses, 1.0 / np.sqrt(S[-1]))


def inverse_of(root: Point) -> Point:
    """Return S^-1 = L^-T L^-1 from `roots(S)`.

    >>> inverse_of(roots((np.array([[4.0]]), np.array([16.0]))))
    (array([[0.25]]), array([0.0625]))
    """
    return (*(R.T @ R for R in root[:-1]), root[-1] ** 2)


def advance(program: ConeProgram, at: Iterate) -> tuple[Iterate, float]:
    """Return the next iterate and the longer of its two step lengths, that of S and that of X.

    Linearizing X = mu S^-1 about S (the HKM direction) and eliminating dS = R + A'(dy), R = slack(y) - S, and
    dX = mu S^-1 - X - sym(X dS S^-1), leaves
        H dy = mu A(S^-1) - cost - A(sym(X R S^-1)),   H_ef = tr(A_e X A_f S^-1).
    The predictor takes mu = 0; the corrector takes the mu which the predictor could have reached, and counts the product
    sym(dX dS S^-1) that the linearization left out (Mehrotra). X and S move as far as they stay inside the cone.

    Raises LinAlgError when the equations cannot be factored, or S or X is not inside the cone.
    """
    root_s, root_x = roots(at.S), roots(at.X)
    Z = inverse_of(root_s)
    H, image_z = program.schur(at.X, Z)
    solve = _solver(H)
    R = tuple(np.zeros_like(s) if at.exact else c - s for c, s in zip(program.slack(at.y), at.S, strict=True))
    missing = _product(at.X, R, Z)
    mean = inner(at.X, at.S) / program.degree
    dy = solve(-program.cost - (0.0 if at.exact else program.adjoint(missing)))
    dS = _sum(R, program.image(dy))
    dX = tuple(-x - c for x, c in zip(at.X, _product(at.X, dS, Z), strict=True))
    a_x, a_s = min(1.0, reach(root_x, dX)), min(1.0, reach(root_s, dS))
    ahead = inner(_moved(at.X, a_x, dX), _moved(at.S, a_s, dS)) / program.degree
    mu = _centering(mean, ahead, min(a_x, a_s)) * mean
    second = _product(dX, dS, Z)
    dy = solve(mu * image_z - program.cost - program.adjoint(_sum(missing, second)))
    dS = _sum(R, program.image(dy))
    dX = tuple(mu * z - x - c - d for z, x, c, d in zip(Z, at.X, _product(at.X, dS, Z), second, strict=True))
    keep = 0.9 + 0.09 * min(a_x, a_s)
    a_x, a_s = min(1.0, keep * reach(root_x, dX)), min(1.0, keep * reach(root_s, dS))
    return _arrived(program, at, (a_x, dX), (a_s, dy, dS)), max(a_x, a_s)


def _arrived(program: ConeProgram, at: Iterate, on_x: tuple[float, Point], on_s: tuple[float, Array, Point]) -> Iterate:
    """Return the iterate after the steps; as soon as the slack at y is inside the cone itself, S becomes that slack."""
    (a_x, dX), (a_s, dy, dS) = on_x, on_s
    y, S, X = at.y + a_s * dy, _moved(at.S, a_s, dS), _moved(at.X, a_x, dX)
    slack = program.slack(y)
    if at.exact or a_s == 1.0:
        return Iterate(y, slack, X, True)
    if inner(X, slack) <= 2.0 * inner(X, S) and inside(slack):
        return Iterate(y, slack, X, True)
    return Iterate(y, S, X, False)


def _centering(mean: float, ahead: float, step: float) -> float:
    """Return the factor of the mean complementarity to aim at: small when the predictor could go far."""
    exponent = max(1.0, 3.0 * step**2) if mean > SMALL else 1.0
    return float(np.clip(max(ahead, 0.0) / mean, 0.0, 1.0) ** exponent) if mean > 0.0 else 0.0


def reach(root: Point, direction: Point) -> float:
    """Return the largest a with S + a * direction in the cone, from `roots(S)`; infinite when there is none.

    S + a D >= 0 says I + a L^-1 D L^-T >= 0, so that a = -1 / (smallest eigenvalue of L^-1 D L^-T), if that is negative.

    >>> reach(roots((4 * np.eye(2), np.ones(1))), (np.diag([1.0, -8.0]), np.array([-1.0])))
    0.5
    """
    lowest = [float(np.min(root[-1] ** 2 * direction[-1], initial=0.0))]
    for R, D in zip(root[:-1], direction[:-1], strict=True):
        if D.size:
            lowest.append(float(np.linalg.eigvalsh(R @ D @ R.T)[0]))
    return -1.0 / min(lowest) if min(lowest) < 0.0 else np.inf


def _solver(H: Array) -> Callable[[Array], Array]:
    """Return a solver of H x = b: Cholesky after scaling H to unit diagonal, a ridge as small as works, and refinement.

    Flat directions, in which no constraint depends on y, have a zero in H; the ridge keeps y where it is along them.
    """
    from scipy.linalg.lapack import dpotrf, dpotrs

    diagonal = np.diag(H)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = unit[:, None] * H * unit
    for ridge in RIDGES:
        factor, failed = dpotrf(scaled + ridge * np.eye(len(H)), lower=1)
        if not failed and np.all(np.isfinite(factor)):
            break
    else:
        raise np.linalg.LinAlgError("the Schur complement is not positive definite")

    def solve(b: Array) -> Array:
        target = unit * b
        x, _ = dpotrs(factor, target, lower=1)
        for _ in range(REFINEMENTS):
            left = target - scaled @ x
            better = x + dpotrs(factor, left, lower=1)[0]
            if not np.linalg.norm(target - scaled @ better) < np.linalg.norm(left):
                break
            x = better
        return unit * x
    return solve


def _product(X: Point, S: Point, Z: Point) -> Point:
    """Return the symmetric part of X S Z, part by part."""
    halves = [x @ s @ z for x, s, z in zip(X[:-1], S[:-1], Z[:-1], strict=True)]
    return (*((half + half.T) / 2 for half in halves), X[-1] * S[-1] * Z[-1])


def _sum(X: Point, Y: Point) -> Point:
    return tuple(x + y for x, y in zip(X, Y, strict=True))


def _moved(X: Point, step: float, direction: Point) -> Point:
    return tuple(x + step * d for x, d in zip(X, direction, strict=True))
