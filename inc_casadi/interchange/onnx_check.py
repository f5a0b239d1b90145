"""A translated network against the original, point by point, its kinks among them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..activations.stack import lipschitz
from ..arrays import Array
from ..errors import TranslationError
from ..inc import INC

SCALES = (0.1, 1.0, 10.0)
HALVINGS = 60
MOST_KINKS = 200


def check_answers(inc: INC, majorant: INC, answers: Callable[[Array], Array], depth: int, dtype: np.dtype,
                  samples: int = 60, seed: int = 0) -> float:
    """Compare an INC with the network that it was made from, and return the largest difference as a share of the allowance.

    At random points of three sizes, and at points where a unit is at a kink, the answers may differ by

        depth (longest + 16) eps (|K| |y| + |V| h + |d|),    h = L (|W| h + |U| |y| + |b|) + |phi(0)|,

    with L the Lipschitz constants of the units and eps the rounding unit of the network's numbers: by the usual analysis a
    chain of `depth` sums of at most `longest` terms errs by no more, whichever way it is summed.

    Parameters
    ----------
    majorant : the INC of absolute values (`Stack.majorant`)
    answers : the original, from one point (p,) of its own number type to u (m,)
    depth : the number of operations in the network

    Raises
    ------
    TranslationError : they differ by more somewhere

    >>> law = INC.saturated([[2.0]], 1.0)
    >>> check_answers(law, law, lambda y: np.clip(2 * y, -1, 1), 1, np.dtype(float)) < 1
    True
    """
    points = sample_points(inc, samples, seed).astype(dtype)
    ours = inc(points.astype(float))
    theirs = np.array([answers(y) for y in points.T], dtype=float).T
    if theirs.shape != ours.shape:
        raise TranslationError(f"the network answers with {theirs.shape[0]} values, its translation with {ours.shape[0]}")
    longest = max(inc.p + inc.q, 1)
    magnitudes = _magnitudes(inc, majorant, np.abs(points.astype(float)))
    allowance = depth * (longest + 16) * float(np.finfo(dtype).eps) * magnitudes
    share = np.abs(ours - theirs) / np.maximum(allowance, np.finfo(float).tiny)
    if not np.all(share <= 1):
        i, j = np.unravel_index(np.argmax(np.nan_to_num(share, nan=np.inf)), share.shape)
        raise TranslationError(f"output {i} of the translation is {float(ours[i, j])!r} at y = {points[:, j].tolist()}, but "
                               f"that of the network is {float(theirs[i, j])!r}: they differ by more than rounding "
                               f"({allowance[i, j]:.3g})")
    return float(np.max(share))


def sample_points(inc: INC, samples: int, seed: int) -> Array:
    """Return points (p, N): random ones of three sizes, and for each unit one where it is at a kink, if any is found.

    Between two random points where a pre-activation lies on different sides of a kink, halving finds the kink.

    >>> points = sample_points(INC.saturated([[2.0]], 1.0), 30, 0)
    >>> bool(np.min(np.abs(points - 0.5)) < 1e-12), bool(np.min(np.abs(points + 0.5)) < 1e-12)
    (True, True)
    """
    rng = np.random.default_rng(seed)
    drawn = np.concatenate([scale * rng.normal(size=(inc.p, samples)) for scale in SCALES], axis=1)
    ends = drawn[:, rng.permutation(drawn.shape[1])]
    low, high, unit, kink = _across(inc, drawn, ends)
    for _ in range(HALVINGS if unit.size else 0):
        middle = (low + high) / 2
        below = _pre_activations(inc, middle)[unit, np.arange(unit.size)] < kink
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.concatenate([drawn, np.zeros((inc.p, 1)), low, high], axis=1)


def _across(inc: INC, first: Array, second: Array) -> tuple[Array, Array, np.ndarray, Array]:
    """The ends, (p, k) each, of segments on which the pre-activation of a unit rises over a kink, with unit and kink."""
    pairs = [(i, kink) for i, unit in enumerate(inc.activations) if unit.pieces is not None for kink in unit.pieces.kinks]
    unit, kink = np.array([i for i, _ in pairs[:MOST_KINKS]], dtype=int), np.array([k for _, k in pairs[:MOST_KINKS]])
    if not unit.size:
        return first[:, :0], first[:, :0], unit, kink
    z1, z2 = (_pre_activations(inc, points)[unit] - kink[:, None] for points in (first, second))
    crossing = z1 * z2 < 0
    found = np.flatnonzero(crossing.any(axis=1))
    which = crossing[found].argmax(axis=1)
    rising = z1[found, which] < 0
    low = np.where(rising, first[:, which], second[:, which])
    high = np.where(rising, second[:, which], first[:, which])
    return low, high, unit[found], kink[found]


def _pre_activations(inc: INC, y: Array) -> Array:
    return inc.W @ inc.hidden(y) + inc.U @ y + inc.b[:, None]


def _magnitudes(inc: INC, majorant: INC, y: Array) -> Array:
    """The bracket of `check_answers` at |y| (p, N); W is nilpotent, so the sum over its powers ends."""
    slopes = lipschitz(inc.activations)[:, None]
    at_zero = np.array([abs(float(unit(0.0))) for unit in inc.activations]).reshape(-1, 1)
    drive, hidden = slopes * (majorant.U @ y + majorant.b[:, None]) + at_zero, np.zeros((inc.q, y.shape[1]))
    for _ in range(inc.q + 1):
        before, hidden = hidden, slopes * (majorant.W @ hidden) + drive
        if np.array_equal(before, hidden):
            break
    return majorant.K @ y + majorant.V @ hidden + majorant.d[:, None]
