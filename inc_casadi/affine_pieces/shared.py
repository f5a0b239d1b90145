"""Outputs that are affine combinations of other outputs need no units of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .pieces import AffinePieces, at


@dataclass(frozen=True, eq=False)
class Shared:
    """u = weights u[kept] + gain y + offset on all pieces, but for `error` in each output.

    kept (r,): outputs, ascending; weights (m, r); gain (m, p), offset (m,), error (m,).
    """

    kept: np.ndarray
    weights: Array
    gain: Array
    offset: Array
    error: Array


def shared(pieces: AffinePieces, counts: Sequence[int], tol: float) -> Shared:
    """Return which outputs to keep, those with few laws first, and the others as combinations of them to within tol.

    f_b = sum_a w_a f_a + an affine law if and only if the laws of all pieces, less those of piece 0, fulfil the same linear
    equations: solved by least squares, and compared at the vertices of all pieces.

    counts (m,): how many distinct laws each output has.
    """
    laws = pieces.laws
    change = np.swapaxes(laws - laws[0], 1, 2).reshape(-1, pieces.m)
    kept: list[int] = []
    rest: dict[int, tuple[Array, float]] = {}
    for b in np.argsort(counts, kind="stable"):
        w = np.linalg.lstsq(change[:, kept], change[:, b], rcond=None)[0]
        affine = laws[0, b] - w @ laws[0, kept]
        away = laws[:, b] - np.einsum("a,kac->kc", w, laws[:, kept]) - affine
        error = float(np.abs(at(away[pieces.owner, None], pieces.corners)).max())
        if error <= tol:
            rest[int(b)] = w, error
        else:
            kept.append(int(b))
    return _collected(pieces, kept, rest)


def _collected(pieces: AffinePieces, order: list[int], rest: dict[int, tuple[Array, float]]) -> Shared:
    kept = np.sort(np.array(order, dtype=int))
    weights, error = np.zeros((pieces.m, len(kept))), np.zeros(pieces.m)
    weights[kept, np.arange(len(kept))] = 1.0
    for b, (w, away) in rest.items():
        weights[b, np.searchsorted(kept, order[: len(w)])] = w
        error[b] = away
    gain, offset = pieces.gain[0] - weights @ pieces.gain[0, kept], pieces.offset[0] - weights @ pieces.offset[0, kept]
    gain[kept], offset[kept] = 0.0, 0.0
    return Shared(kept, weights, gain, offset, error)
