"""The exact projection of a matrix on the ball ||W||_inf <= kappa, the update of prop:projected_training_wp."""

from __future__ import annotations

import numpy as np

from inc_casadi.arrays import Array


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
