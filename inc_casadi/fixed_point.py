"""Solve eta = phi(W eta + c) for many c at once, and never return a point whose residual was not checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .activations.stack import Units, derivative, evaluate
from .arrays import Array
from .brief import Brief
from .errors import ConvergenceError, InvalidInputError
from .splitting import prepare

TOLERANCE = 1e-12
FREE_STEPS = 20
FIRST_ROUND, LONGEST_ROUND = 10, 1000  # splitting iterations between two looks at the residual


@dataclass(frozen=True, eq=False)
class FixedPoint(Brief):
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


def solve(W: Array, c: Array, units: Units, *, rate: float, weights: Array, T: Array | None = None, method: str = "auto",
          tolerance: float = TOLERANCE, max_iterations: int = 100_000) -> FixedPoint:
    """Return the fixed points of eta = phi(W eta + c) for columns c (q, N).

    "auto" takes one pass when W is feedforward, else the cheaper of "newton" and "picard", which iterates from zero. Both
    converge for every W with `rate` < 1, the contraction rate in the norm max_i |eta_i| / weights_i (thm:wellposed): a
    column that 20 full Newton steps did not solve (none was ever seen) goes on with safeguarded ones, where Newton's step
    is taken only if it shrinks the residual nearly as much as a Picard step must, and a Picard step otherwise.

    Where only a multiplier T (q,) proves well-posedness, `rate` >= 1, Picard may diverge and "auto" never takes it. Columns
    that the 20 Newton steps did not solve go on with the iteration of `splitting`, which converges linearly for every W with
    a T; now and then Newton's steps are tried from where it is, and kept where they solve a column. "splitting" is that
    iteration alone, without Newton's steps.

    The tolerance is relative to the size of (eta, c) in each column, and at least absolute for columns below 1.
    Raises ConvergenceError with the residual, InvalidInputError for an unknown method or one that lacks its T.

    >>> from inc_casadi.activations import ReLU
    >>> found = solve(np.array([[0.5]]), np.array([[1.0]]), (ReLU(),), rate=0.5, weights=np.ones(1))
    >>> found.eta.round(12).tolist()
    [[2.0]]
    >>> found = solve(np.array([[-3.0]]), np.array([[1.0]]), (ReLU(),), rate=3.0, weights=np.ones(1), T=np.ones(1))
    >>> found.eta.round(12).tolist(), found.method
    ([[0.25]], 'newton')
    """
    if method not in ("auto", "picard", "newton", "splitting"):
        raise InvalidInputError(f"method is {method!r}, but must be 'auto', 'picard', 'newton' or 'splitting'")
    if T is None and method == "splitting":
        raise InvalidInputError("method is 'splitting', but no multiplier T is given: there is no metric to contract in")
    levels = feedforward_levels(W) if method == "auto" else None
    if method == "auto":
        method = "picard" if _picard_is_cheaper(c.shape, rate, tolerance) else "newton"
    if levels is not None:
        eta, iterations, method = _one_pass(W, c, units, levels), 1, "feedforward"
    elif method == "picard":
        eta, iterations = _picard(W, c, units, tolerance, max_iterations)
    elif T is not None and method == "splitting":
        eta, iterations = _split(W, c, units, T, evaluate(units, c), tolerance, max_iterations, newton_steps=0)
    else:
        eta, iterations = _newton(W, c, units, rate, weights, tolerance, safeguarded=rate < 1.0)
        if T is not None and rate >= 1.0:
            eta, more = _split(W, c, units, T, eta, tolerance, max_iterations, newton_steps=5)
            iterations, method = iterations + more, "newton and splitting" if more else method
    return _checked(W, c, units, eta, iterations, method, tolerance)


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
    with np.errstate(over="ignore", invalid="ignore"):  # where it diverges, the residual says so
        for iteration in range(1, max_iterations + 1):
            new = evaluate(units, W @ eta + c)
            change, eta = np.abs(new - eta), new
            if np.all(change <= tolerance * _scale(eta, c)) or not np.all(np.isfinite(eta)):
                return eta, iteration
    return eta, max_iterations


def _newton(W: Array, c: Array, units: Units, rate: float, weights: Array, tolerance: float,
            safeguarded: bool) -> tuple[Array, int]:
    """Newton's steps from phi(c): 20 full ones, then, where Picard contracts, safeguarded ones."""
    eta = evaluate(units, c)
    image = evaluate(units, W @ eta + c)
    evaluations = 2
    # Half way between the contraction rate and 1: the rate itself could stall on rounding.
    shrink = 0.5 * (1.0 + min(rate, 1.0))
    more = int(60 / max(1.0 - rate, 1e-4)) if safeguarded else 0
    for step in range(FREE_STEPS + more):
        residual = image - eta
        open_columns = np.flatnonzero(np.any(np.abs(residual) > tolerance * _scale(eta, c), axis=0))
        if open_columns.size == 0:
            break
        e, r, k = eta[:, open_columns], residual[:, open_columns], c[:, open_columns]
        trial, picard = _newton_step(W, e, k, r, units), e + r
        trial_image = evaluate(units, W @ trial + k)
        norm_now = np.max(np.abs(r) / weights[:, None], axis=0)
        norm_new = np.max(np.abs(trial_image - trial) / weights[:, None], axis=0)
        good = (norm_new <= shrink * norm_now) | (step < FREE_STEPS)
        eta[:, open_columns] = np.where(good, trial, picard)
        image[:, open_columns] = np.where(good, trial_image, evaluate(units, W @ picard + k))
        evaluations += 2
    return eta, evaluations


def _newton_step(W: Array, eta: Array, c: Array, residual: Array, units: Units) -> Array:
    """eta + (I - D W)^{-1} residual: the matrix is nonsingular for every D of slopes, by either test of well-posedness."""
    slope = derivative(units, W @ eta + c)
    jacobian = np.eye(W.shape[0])[None] - slope.T[:, :, None] * W[None]
    return eta + np.linalg.solve(jacobian, residual.T[:, :, None])[:, :, 0].T


def _split(W: Array, c: Array, units: Units, T: Array, eta: Array, tolerance: float, max_iterations: int,
           newton_steps: int) -> tuple[Array, int]:
    """Splitting iterations for the columns that eta (q, N) does not solve, in rounds that double in length.

    Newton's steps start from a copy at the end of a round: they can end the work early, and cannot disturb it.
    """
    open_columns = np.flatnonzero(_is_open(W, c, units, eta, tolerance))
    done, length = 0, FIRST_ROUND
    if open_columns.size == 0:
        return eta, 0
    splitting = prepare(W, units, T)
    w = splitting.begin(eta[:, open_columns], c[:, open_columns], W)
    while open_columns.size and done < max_iterations:
        k, length = c[:, open_columns], min(length, max_iterations - done)
        w, guess = splitting.iterate(w, k, length)
        for _ in range(newton_steps):
            guess = np.where(_is_open(W, k, units, guess, tolerance),
                             _newton_step(W, guess, k, evaluate(units, W @ guess + k) - guess, units), guess)
        eta[:, open_columns] = guess
        left = _is_open(W, k, units, guess, tolerance)
        open_columns, w = open_columns[left], w[:, left]
        done, length = done + length, min(2 * length, LONGEST_ROUND)
    return eta, done


def _is_open(W: Array, c: Array, units: Units, eta: Array, tolerance: float) -> np.ndarray:
    """Which columns (N,) have a residual above the tolerance."""
    return np.any(np.abs(evaluate(units, W @ eta + c) - eta) > tolerance * _scale(eta, c), axis=0)


def _checked(W: Array, c: Array, units: Units, eta: Array, iterations: int, method: str, tolerance: float) -> FixedPoint:
    with np.errstate(over="ignore", invalid="ignore"):
        residual = np.abs(eta - evaluate(units, W @ eta + c))
    worst = float(np.max(residual, initial=0.0))
    if not np.all(residual <= 4 * tolerance * _scale(eta, c)):
        raise ConvergenceError(f"the fixed point has residual {worst:.3g} after {iterations} evaluations ({method}), "
                               f"above the tolerance {tolerance:.3g}: no value of eta is returned")
    return FixedPoint(eta, worst, iterations, method)


def _scale(eta: Array, c: Array) -> Array:
    return np.maximum(1.0, np.maximum(np.max(np.abs(eta), axis=0, initial=0.0), np.max(np.abs(c), axis=0, initial=0.0)))
