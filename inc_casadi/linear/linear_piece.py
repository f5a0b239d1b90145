"""The affine piece of a law around y = 0, in Fractions: the gain there, and how far hidden units are from their kinks."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..activations.piecewise import Pieces
from ..arrays import Array
from ..blocks import exact
from ..exact import solve
from ..inc import INC

MOST_UNITS = 40  # above which eliminating in fractions takes too long
Ends = list[tuple[Fraction | None, Fraction | None]]


@dataclass(frozen=True, eq=False)
class LinearPiece:
    """Where a law is affine: u = u_0 + K y as long as z - z_0 = Z y stays within `room`.

    z = W eta + U y + b are the pre-activations. Between two neighbouring kinks unit i is affine, phi_i(z_i) = s_i z_i + c_i.
    While all z_i stay between theirs, the fixed point solves (I - W S) z = U y + W c + b, which is the law's by uniqueness,
    so that z = z_0 + Z y and u = u_0 + K y with Z = (I - W S)^-1 U and K + V S Z for K.

    Parameters
    ----------
    K : (m, p) Fractions
    u_0 : (m,) Fractions, the input at y = 0
    Z : (q, p) Fractions, of the units that an output depends on
    slopes : (q,) floats s_i
    room : for each of these units how far z_i may move down (at most 0) and up (at least 0), None without end
    """

    K: np.ndarray
    u_0: np.ndarray
    Z: np.ndarray
    slopes: Array
    room: Ends


def linear_piece(inc: INC) -> LinearPiece | str:
    """Return the affine piece of a well-posed law around y = 0, or in words why there is none.

    >>> piece = linear_piece(INC.saturated([[3.0]], 2.0))
    >>> piece.K.tolist(), piece.room
    ([[Fraction(3, 1)]], [(Fraction(-1, 1), Fraction(1, 1))])
    >>> linear_piece(INC([[0.0]], [[1.0]], [[1.0]], [[0.0]]))
    'unit 0 rests on a kink at y = 0'
    """
    law = inc.without_idle_units()
    if law.q > MOST_UNITS:
        return f"it has {law.q} hidden units, and up to {MOST_UNITS} are solved for in fractions"
    curved = [i for i, unit in enumerate(law.activations) if unit.pieces is None]
    if curved:
        return f"unit {curved[0]} is curved, so that the law is affine nowhere"
    pieces = [unit.pieces for unit in law.activations if unit.pieces is not None]
    levels = law.W @ law.hidden(np.zeros(law.p)) + law.b
    places = [int(piece.index(level)) for piece, level in zip(pieces, levels, strict=True)]
    return _on(law, pieces, places)


def _on(law: INC, pieces: list[Pieces], places: list[int]) -> LinearPiece | str:
    s, c = (exact(np.array([float(values[j]) for values, j in zip(part, places, strict=True)]))
            for part in ([one.slopes for one in pieces], [one.intercepts for one in pieces]))
    W, U, V, K, b, d = (exact(part) for part in (law.W, law.U, law.V, law.K, law.b, law.d))
    if not law.q:
        return LinearPiece(K, d, U, np.zeros(0), [])
    z_0, Z = _solved(W, s, W @ c + b, U)
    if Z is None:
        return "I - W S is singular"
    room = [_room(piece, j, level) for piece, j, level in zip(pieces, places, z_0, strict=True)]
    tight = [i for i, (low, high) in enumerate(room) if low is not None and low >= 0 or high is not None and high <= 0]
    if tight:
        return f"unit {tight[0]} rests on a kink at y = 0"
    return LinearPiece(K + (V * s) @ Z, V @ (s * z_0 + c) + d, Z, s.astype(float), room)


def _solved(W: np.ndarray, s: np.ndarray, offset: np.ndarray, U: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return z_0 and Z of (I - W S) z = offset + U y."""
    if not np.any(W * s != 0):
        return offset, U
    M = exact(np.eye(len(W))) - W * s
    columns = [solve(M, column) for column in (offset, *U.T)]
    found = [column for column in columns if column is not None]
    return (found[0], np.stack(found[1:], axis=1)) if len(found) == len(columns) else (offset, None)


def _room(piece: Pieces, j: int, level: Fraction) -> tuple[Fraction | None, Fraction | None]:
    low = Fraction(float(piece.kinks[j - 1])) - level if j > 0 else None
    high = Fraction(float(piece.kinks[j])) - level if j < len(piece.kinks) else None
    return low, high
