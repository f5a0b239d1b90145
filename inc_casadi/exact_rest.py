"""Where a biased loop rests, in rational arithmetic."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np

from .activations.stack import Units
from .blocks import exact
from .errors import ConvergenceError, NoEquilibriumError, NotWellPosedError
from .exact import solve
from .inc import INC
from .loop import equilibrium
from .plant import Plant

LARGEST = 40  # states and hidden units, above which eliminating in fractions takes too long
ATTEMPTS = 20


class RestPoint(NamedTuple):
    """An equilibrium x = A x + B u (discrete) or 0 = A x + B u, exactly: arrays of Fractions x (n,), z (q,), u (m,)."""

    x: np.ndarray
    z: np.ndarray
    u: np.ndarray


def rest_point(plant: Plant, inc: INC) -> RestPoint | None:
    """Return an equilibrium in Fractions, or None when a unit is curved, the loop large, or none was settled.

    On the pieces that the pre-activations lie on, eta_i = s_i z_i + c_i makes the equations of eq:equilibrium_incremental
    linear in (x, z); the guess comes from Newton's method in floats, and each unit moves to the piece that its exact z_i
    lies in until none moves. Then every equation holds exactly. The origin is tried first: with discount < 1 there may be
    several equilibria, and the cost is counted from there.

    >>> rest_point(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[0.0]], [[1.0]], [[0.0]], b=[1.0])).x.tolist()
    [Fraction(2, 1)]
    """
    if plant.n + inc.q > LARGEST or any(unit.pieces is None for unit in inc.activations):
        return None
    starts = [np.zeros(plant.n)]
    try:
        starts.append(equilibrium(plant, inc).x)
    except (NoEquilibriumError, ConvergenceError, NotWellPosedError):
        pass  # the origin may be one all the same
    for attempt, start in enumerate(starts):
        try:
            y = plant.C @ start
            found = _settled(plant, inc, inc.W @ inc.hidden(y) + inc.U @ y + inc.b)
        except (ConvergenceError, NotWellPosedError):
            return None
        if found is not None and (attempt > 0 or not found.x.any()):
            return found
    return None


def _settled(plant: Plant, inc: INC, levels: np.ndarray) -> RestPoint | None:
    """Return the equilibrium on the pieces of `levels`, moved until its own levels lie on them."""
    z = exact(levels)
    seen = set()
    for _ in range(ATTEMPTS):
        pattern = _pieces_at(inc.activations, z)
        if pattern in seen:
            return None
        seen.add(pattern)
        found = _on_pieces(plant, inc, pattern)
        if found is None:
            return None
        if _lies_on(inc.activations, found.z, pattern):
            return found
        z = found.z
    return None


def _pieces_at(units: Units, z: np.ndarray) -> tuple[int, ...]:
    return tuple(sum(level >= Fraction(float(kink)) for kink in unit.pieces.kinks)  # type: ignore[union-attr]
                 for unit, level in zip(units, z, strict=True))


def _lies_on(units: Units, z: np.ndarray, pattern: tuple[int, ...]) -> bool:
    """Whether each level lies on its closed piece."""
    for unit, level, j in zip(units, z, pattern, strict=True):
        kinks = exact(unit.pieces.kinks)  # type: ignore[union-attr]
        if (j > 0 and level < kinks[j - 1]) or (j < len(kinks) and level > kinks[j]):
            return False
    return True


def _on_pieces(plant: Plant, inc: INC, pattern: tuple[int, ...]) -> RestPoint | None:
    """Solve A x + B u - x = 0 (or A x + B u = 0), z = W eta + U C x + b, eta = S z + c in fractions."""
    n, q = plant.n, inc.q
    A, B, C = (exact(part) for part in (plant.A, plant.B, plant.C))
    W, U, V, K, b, d = (exact(part) for part in (inc.W, inc.U, inc.V, inc.K, inc.b, inc.d))
    pieces = [unit.pieces for unit in inc.activations]
    s = exact(np.array([piece.slopes[j] for piece, j in zip(pieces, pattern, strict=True)]))  # type: ignore[union-attr]
    c = exact(np.array([piece.intercepts[j] for piece, j in zip(pieces, pattern, strict=True)]))  # type: ignore[union-attr]
    shift = exact(np.eye(n)) if plant.discrete else exact(np.zeros((n, n)))
    top = np.hstack([A + B @ K @ C - shift, (B @ V) * s])
    bottom = np.hstack([-(U @ C), exact(np.eye(q)) - W * s])
    right = np.concatenate([-(B @ (V @ c + d)), W @ c + b]) if q else -(B @ d)
    solution = solve(np.vstack([top, bottom]), right)
    if solution is None:
        return None
    x, z = solution[:n], solution[n:]
    u = K @ (C @ x) + d + (V @ (s * z + c) if q else exact(np.zeros(inc.m)))
    return RestPoint(x, z, u)
