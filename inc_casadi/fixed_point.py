"""Solve eta = phi(W eta + c) for many c at once, and never return a point whose residual was not checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .activations.stack import Units, derivative, evaluate
from .arrays import Array
from .errors import ConvergenceError, InvalidInputError

TOLERANCE = 1e-12
FREE_STEPS = 20


@dataclass(frozen=True, eq=False)
class FixedPoint:
    """Solutions eta (q, N) of eta = phi(W eta + c), with how they were found.

    residual: the largest |eta - phi(W eta + c)|; iterations: evaluations of phi, 1 for a feedforward pass.
    """

    eta: Array
    residual: float
    iterations: int
    method: str


def feedforward_levels(W: Array) -> list[np.ndarray] | None:
    """Return the hidden units in levels that only read earlier levels, or None when W has a loop.

    The structure of W decides, not its numbers' size: a unit is free once all units it reads are done.

    >>> [level.tolist() for level in feedforward_levels(np.array([[0.0, 0.0], [2.0, 0.0]]))]
    [[0], [1]]
    """
    reads = W != 0
    done = np.zeros(W.shape[0], dtype=bool)
    levels = []
    while not done.all():
        level = ~done & ~np.any(reads & ~done[None, :], axis=1)
        if not level.any():
            return None
        levels.append(np.flatnonzero(level))
        done |= level
    return levels


def solve(W: Array, c: Array, units: Units, *, rate: float, weights: Array, method: str = "auto",
          tolerance: float = TOLERANCE, max_iterations: int = 100_000) -> FixedPoint:
    """Return the fixed points of eta = phi(W eta + c) for columns c (q, N).

    "auto" takes one pass when W is feedforward, else the cheaper of "newton" and "picard", which iterates from zero. Both
    converge for every W with `rate` < 1, the contraction rate in the norm max_i |eta_i| / weights_i (thm:wellposed): a
    column that 20 full Newton steps did not solve (none was ever seen) goes on with safeguarded ones, where Newton's step
    is taken only if it shrinks the residual nearly as much as a Picard step must, and a Picard step otherwise.

    The tolerance is relative to the size of (eta, c) in each column, and at least absolute for columns below 1.
    Raises ConvergenceError with the residual, InvalidInputError for an unknown method.

    >>> from inc_casadi.activations import ReLU
    >>> found = solve(np.array([[0.5]]), np.array([[1.0]]), (ReLU(),), rate=0.5, weights=np.ones(1))
    >>> found.eta.round(12).tolist()
    [[2.0]]
    """
    if method not in ("auto", "picard", "newton"):
        raise InvalidInputError(f"method is {method!r}, but must be 'auto', 'picard' or 'newton'")
    levels = feedforward_levels(W) if method == "auto" else None
    if method == "auto":
        method = "picard" if _picard_is_cheaper(c.shape, rate, tolerance) else "newton"
    if levels is not None:
        eta, iterations, name = _one_pass(W, c, units, levels), 1, "feedforward"
    elif method == "picard":
        eta, iterations = _picard(W, c, units, tolerance, max_iterations)
        name = "picard"
    else:
        eta, iterations = _newton(W, c, units, rate, weights, tolerance)
        name = "newton"
    return _checked(W, c, units, eta, iterations, name, tolerance)


def _picard_is_cheaper(shape: tuple[int, ...], rate: float, tolerance: float) -> bool:
    """Whether Picard's log(tolerance) / log(rate) products with W cost less than Newton's half dozen factorizations.

    For few columns the calls themselves cost more than the arithmetic, and Newton makes fewer.
    """
    q, count = shape
    if count < 8 or rate >= 1.0:
        return False
    return bool(np.log(tolerance) / np.log(max(rate, 1e-3)) < 2 * q)


def _one_pass(W: Array, c: Array, units: Units, levels: list[np.ndarray]) -> Array:
    eta = np.zeros_like(c)
    for level in levels:
        eta[level] = evaluate(tuple(units[i] for i in level), W[level] @ eta + c[level])
    return eta


def _picard(W: Array, c: Array, units: Units, tolerance: float, max_iterations: int) -> tuple[Array, int]:
    eta = np.zeros_like(c)
    for iteration in range(1, max_iterations + 1):
        new = evaluate(units, W @ eta + c)
        change, eta = np.abs(new - eta), new
        if np.all(change <= tolerance * _scale(eta, c)):
            return eta, iteration
    return eta, max_iterations


def _newton(W: Array, c: Array, units: Units, rate: float, weights: Array, tolerance: float) -> tuple[Array, int]:
    q = W.shape[0]
    eta = evaluate(units, c)
    image = evaluate(units, W @ eta + c)
    evaluations = 2
    # Half way between the contraction rate and 1: the rate itself could stall on rounding.
    shrink = 0.5 * (1.0 + min(rate, 1.0))
    for step in range(FREE_STEPS + int(60 / max(1.0 - rate, 1e-4))):
        residual = image - eta
        open_columns = np.flatnonzero(np.any(np.abs(residual) > tolerance * _scale(eta, c), axis=0))
        if open_columns.size == 0:
            break
        e, r, k = eta[:, open_columns], residual[:, open_columns], c[:, open_columns]
        slope = derivative(units, W @ e + k)
        jacobian = np.eye(q)[None] - slope.T[:, :, None] * W[None]
        trial = e + np.linalg.solve(jacobian, r.T[:, :, None])[:, :, 0].T
        trial_image = evaluate(units, W @ trial + k)
        norm_now = np.max(np.abs(r) / weights[:, None], axis=0)
        norm_new = np.max(np.abs(trial_image - trial) / weights[:, None], axis=0)
        good = (norm_new <= shrink * norm_now) | (step < FREE_STEPS)
        picard = e + r
        picard_image = evaluate(units, W @ picard + k)
        eta[:, open_columns] = np.where(good, trial, picard)
        image[:, open_columns] = np.where(good, trial_image, picard_image)
        evaluations += 2
    return eta, evaluations


def _checked(W: Array, c: Array, units: Units, eta: Array, iterations: int, method: str, tolerance: float) -> FixedPoint:
    residual = np.abs(eta - evaluate(units, W @ eta + c))
    worst = float(np.max(residual, initial=0.0))
    if not np.all(residual <= 4 * tolerance * _scale(eta, c)):
        raise ConvergenceError(f"the fixed point has residual {worst:.3g} after {iterations} evaluations ({method}), "
                               f"above the tolerance {tolerance:.3g}: no value of eta is returned")
    return FixedPoint(eta, worst, iterations, method)


def _scale(eta: Array, c: Array) -> Array:
    return np.maximum(1.0, np.maximum(np.max(np.abs(eta), axis=0, initial=0.0), np.max(np.abs(c), axis=0, initial=0.0)))
