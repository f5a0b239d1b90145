"""The Lyapunov inequalities of a loop that stays on one affine piece: formed in any arithmetic, measured, decided."""

from __future__ import annotations

from typing import Any

from ..arrays import Array
from ..certificate import EXACT, FLOAT
from ..definite import definiteness, is_surely_positive, smallest_eigenvalue, with_sign
from ..exact import is_positive_definite
from ..readings import Rational, Rounded
from .lyapunov import bounding_sum
from .piece_loop import PieceLoop


def conditions(loop: PieceLoop, P: Array | None, W: Array | None, kind: Any) -> dict[str, Any]:
    """Return the symmetric matrices that must be positive definite, by name; none about what is None.

    P > 0, P - discount F_s'P F_s - Q - G'R G > 0; W > 0, W - F'W F - O'D O > 0 (`UnswitchedCost`).

    >>> from inc_casadi import INC, Box, Plant, Spec
    >>> import numpy as np
    >>> from inc_casadi.linear.piece_loop import piece_loop
    >>> loop = piece_loop(Plant(1.5, 1.0), Spec(1.0, 0.0, 0.5, Box(-1, 1), Box(-1, 1)), INC.linear([[-1.0]]))
    >>> conditions(loop, np.array([[2.0]]), None, Rational)["P falls by the stage cost"].fractions().tolist()
    [[Fraction(3, 4)]]
    """
    matrices, spec = loop.read(kind), loop.spec
    found: dict[str, Any] = {}
    if P is not None:
        step, u = matrices.step, matrices.inputs
        kept = (step.T @ kind.lift(P) @ step) * spec.discount
        found |= {"P > 0": kind.lift(P), "P falls by the stage cost": kind.lift(P) - kept - loop.Q - u.T @ spec.R @ u}
    if W is not None:
        F, outputs = matrices.F, matrices.G
        found |= {"W > 0": kind.lift(W), "W falls by the outputs": kind.lift(W) - F.T @ W @ F - outputs.T @ loop.D @ outputs}
    return found


def are_surely_met(loop: PieceLoop, P: Array | None, W: Array | None) -> bool:
    """Return whether floats with every rounding bounded show all of them; False leaves it open."""
    return all(is_surely_positive(one) for one in conditions(loop, P, W, Rounded).values())


def margins_of(loop: PieceLoop, P: Array | None, W: Array | None) -> dict[str, float]:
    """Return the smallest eigenvalue of each, relative to its diagonal and less all rounding; its sign is decided."""
    found = {}
    for name, condition in conditions(loop, P, W, Rounded).items():
        smallest, room = smallest_eigenvalue(condition)
        open_ = not (smallest - room > 0 or not smallest + room >= 0)
        found[name] = with_sign(smallest, _is_positive(loop, P, W, name, condition)) if open_ else smallest - room
    return found


def failing(loop: PieceLoop, P: Array | None, W: Array | None) -> tuple[str, str]:
    """Return the name of the first that is not positive definite, or "", and by which arithmetic all were settled."""
    method = FLOAT
    for name, condition in conditions(loop, P, W, Rounded).items():
        if not is_surely_positive(condition):
            method = EXACT
            if not _is_positive(loop, P, W, name, condition):
                return name, method
    return "", method


def _is_positive(loop: PieceLoop, P: Array | None, W: Array | None, name: str, condition: Rounded) -> bool:
    decided = definiteness(condition)
    return is_positive_definite(conditions(loop, P, W, Rational)[name].numbers) if decided is None else decided


def smallest_storages(loop: PieceLoop, discount: float) -> tuple[Array | None, Array | None]:
    """Return P = sum_k discount^k (F_s^k)'(Q + G'RG) F_s^k and W = sum_k (F^k)'O'D O F^k, None where a sum has no end.

    Both raised by the least share from 1e-13 on that rounding allows to prove.
    """
    parts = loop.read(Rounded)
    outputs = parts.G.value
    P = bounding_sum(parts.step.value, loop.stage, discount, lambda P: are_surely_met(loop, P, None))
    W = bounding_sum(parts.F.value, outputs.T @ loop.D @ outputs, 1.0, lambda W: are_surely_met(loop, None, W))
    return P, W
