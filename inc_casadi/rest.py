"""What a controller answers at y = 0, in rational arithmetic: does a biased loop rest at the origin?"""

from __future__ import annotations

import numpy as np

from .blocks import exact
from .exact import solve
from .inc import INC

ATTEMPTS = 50


def rest_output(inc: INC) -> np.ndarray | None:
    """Return u = inc(0) as exact Fractions (m,), or None when a unit is not piecewise affine or no pattern was settled.

    On guessed pieces eta_i = s_i z_i + c_i the fixed point is linear, eta = (I - S W)^{-1} (S b + c). The guess starts
    from the floating-point solution and moves each unit to the piece that its exact z_i lies in, until none moves;
    then eta = phi(W eta + b) holds exactly, and by well-posedness, whichever test proves it, it is the only solution.

    Raises NotWellPosedError when the fixed point is not proved unique.

    >>> from inc_casadi import INC
    >>> inc = INC(np.zeros((2, 2)), [[1.5], [1.5]], [[-1.0, 1.0]], [[0.0]], b=[1.0, -1.0], d=[1.0])
    >>> rest_output(inc).tolist()
    [Fraction(0, 1)]
    """
    pieces = [unit.pieces for unit in inc.activations]
    z = exact(inc.W @ inc.hidden(np.zeros(inc.p)) + inc.b)
    W, V, b, d = exact(inc.W), exact(inc.V), exact(inc.b), exact(inc.d)
    if inc.q == 0:
        return d
    for _ in range(ATTEMPTS):
        chosen = []
        for piece, level in zip(pieces, z, strict=True):
            if piece is None:
                return None
            j = sum(level >= kink for kink in exact(piece.kinks))
            chosen.append((exact(piece.slopes)[j], exact(piece.intercepts)[j]))
        slopes, intercepts = np.array(chosen, dtype=object).T
        eta = solve(exact(np.eye(inc.q)) - slopes[:, None] * W, slopes * b + intercepts)
        if eta is None:
            return None
        new = W @ eta + b
        if _same_pieces(pieces, z, new):
            return V @ eta + d
        z = new
    return None


def _same_pieces(pieces: list, z: np.ndarray, new: np.ndarray) -> bool:
    """Whether each new level lies in the closed piece that the old one chose."""
    for piece, old, level in zip(pieces, z, new, strict=True):
        kinks = exact(piece.kinks)
        j = sum(old >= kink for kink in kinks)
        if (j > 0 and level < kinks[j - 1]) or (j < len(kinks) and level > kinks[j]):
            return False
    return True
