"""Into the ball ||W||_inf <= kappa: by projection (prop:projected_training_wp), or by rescaling units."""

from __future__ import annotations

import numpy as np

from inc_casadi.activations import stack
from inc_casadi.arrays import Array
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC


def project_rows(W: Array, radius: float) -> Array:
    """Return the nearest matrix, in the Frobenius norm, whose rows have l1 norm at most `radius`.

    Rows are apart, since ||W||_inf is the largest l1 norm of a row. A row inside stays. Of one outside every entry moves
    to zero by the same threshold t > 0, w -> sign(w) max(|w| - t, 0), with t such that the norm becomes the radius: these
    are the optimality conditions of the projection, and t = (sum of the k largest |w| - radius) / k for the largest k
    whose k-th entry exceeds it. Exact up to rounding, and rounding never leaves a computed row sum above the radius.

    Parameters
    ----------
    W : (q, c)
    radius : > 0

    Notes
    -----
    Duchi, Shalev-Shwartz, Singer and Chandra, Efficient projections onto the l1-ball for learning in high dimensions,
    ICML 2008. O(q c log c), all rows at once.

    Examples
    --------
    >>> project_rows(np.array([[3.0, -1.0], [0.2, 0.3]]), 1.0).tolist()
    [[1.0, 0.0], [0.2, 0.3]]
    """
    if W.size == 0:
        return W
    size = np.abs(W)
    outside = size.sum(axis=1) > radius
    if not outside.any():
        return W
    descending = -np.sort(-size[outside], axis=1)
    thresholds = (np.cumsum(descending, axis=1) - radius) / np.arange(1, W.shape[1] + 1)
    k = np.sum(descending > thresholds, axis=1)
    t = thresholds[np.arange(k.size), k - 1]
    out = W.copy()
    # copysign would turn zeros into -0: the product with the sign does too, but adding 0 removes it.
    out[outside] = np.sign(W[outside]) * np.maximum(size[outside] - t[:, None], 0.0) + 0.0
    return _within(out, radius)


def _within(W: Array, radius: float) -> Array:
    """Shrink by a few units of rounding the rows whose computed sum still exceeds the radius."""
    norms = np.abs(W).sum(axis=1, keepdims=True)
    shrink = radius / np.maximum(norms, radius) * (1.0 - 4 * W.shape[1] * np.finfo(float).eps)
    return np.where(norms > radius, W * shrink, W)


def row_bound(units: stack.Units, kappa: float) -> float:
    """Return the bound on the row sums of |W|: kappa, or less where units are steeper than 1.

    >>> from inc_casadi import ReLU
    >>> row_bound((ReLU(),), 0.9)
    0.9
    """
    return kappa / max(1.0, float(np.max(stack.lipschitz(units), initial=0.0)))


def balanced(start: INC, bound: float) -> INC:
    """Return the same law with ||W||_inf <= bound, rescaling units that are linear on both half lines if need be.

    For v > 0 the hidden units eta / v have W' = diag(1/v) W diag(v), and ||W'||_inf <= c where |W| v <= c v. Units that
    cannot be rescaled keep v = 1; the others get the v that |W| v = c v - t asks of them, with the largest t that fits.

    Raises
    ------
    InvalidInputError : the norm is above the bound and cannot be brought below

    >>> deep = INC(W=[[0.0, 0.0], [5.0, 0.0]], U=[[1.0], [0.0]], V=[[0.0, 1.0]], K=[[0.0]])
    >>> even = balanced(deep, 0.9)
    >>> even.well_posedness().norm < 0.9, even([2.0]).round(9).tolist()
    (True, [10.0])
    """
    norm = float(np.max(np.abs(start.W).sum(axis=1), initial=0.0))
    if norm <= bound:
        return start
    v = _weights(np.abs(start.W), np.array([unit.homogeneous is not None for unit in start.activations]), 0.95 * bound)
    if v is None:
        raise InvalidInputError(f"start has ||W||_inf = {norm:.6g}, above the bound {bound:.6g} of the training, and "
                                "its units cannot be rescaled to meet it: raise kappa, project W first, or freeze W")
    return INC(start.W * v / v[:, None], start.U / v[:, None], start.V * v, start.K, start.b / v, start.d,
               start.activation)


def _weights(M: Array, free: np.ndarray, level: float) -> Array | None:
    """Return v > 0 with M v <= level v and v = 1 outside `free`, or None when this way finds none."""
    inner = M[np.ix_(free, free)]
    if inner.size and np.max(np.abs(np.linalg.eigvals(inner))) >= level:
        return None
    fed = np.column_stack([M[np.ix_(free, ~free)].sum(axis=1), np.ones(inner.shape[0])])
    least, more = np.linalg.solve(level * np.eye(inner.shape[0]) - inner, fed).T
    room = level - M[np.ix_(~free, ~free)].sum(axis=1) - M[np.ix_(~free, free)] @ least
    use = M[np.ix_(~free, free)] @ more
    t = float(np.min(room[use > 0] / use[use > 0], initial=1.0))
    if t <= 0.0 or np.any(room < 0.0):
        return None
    v = np.ones(M.shape[0])
    v[free] = least + t * more
    return v
