"""What makes a claim about every state hopeless for a loop, whatever numbers are searched: the most telling reason."""

from __future__ import annotations

import numpy as np

from .arrays import Array
from .errors import ConvergenceError, NoEquilibriumError, NotWellPosedError
from .inc import INC
from .loop import equilibrium
from .plant import Plant

CLEAR = 1e-9  # by how much a spectral radius must be too large to be named
FAR = "from far away it holds no motion"
KINK = 1e-9  # distance of a pre-activation from a kink, below which the law may not have a derivative


def hindrance(plant: Plant, inc: INC, growth: float) -> str:
    """Return in words why no certificate about every state can exist, or an empty string where nothing was noticed.

    growth: what the claim allows motions to grow by at most, a factor per step, or a rate in 1/s (`Claim.growth`). Two
    things rule such a claim out: a law whose output is bounded and a plant that grows faster by itself, for far out the
    law does not count; and a linearization at the equilibrium, where the law has a derivative, that grows faster.

    Computed in floats, to explain a refusal: it proves nothing.

    >>> hindrance(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.5]], 1.0), 1.0)
    'the plant alone has spectral radius 1.5, not below 1, and the law is bounded: from far away it holds no motion'
    """
    alone = too_fast(plant, plant.A, growth)
    if alone and _is_bounded(inc):
        return f"the plant alone has {alone}, and the law is bounded: {FAR}"
    found = linearization(plant, inc)
    local = "" if found is None else too_fast(plant, found[0], growth)
    return f"around its equilibrium {point(found[1])} the loop has {local}" if found and local else ""


def linearization(plant: Plant, inc: INC, x: Array | None = None) -> tuple[Array, Array] | None:
    """Return A + B (du/dy) C at an equilibrium x* (n,), and x*; None where none is found or x* lies on a kink of the law.

    x: the equilibrium, where it is known.

    >>> linearization(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.2]], 1.0))[0].round(9).tolist()
    [[0.3]]
    """
    try:
        rest = equilibrium(plant, inc).x if x is None else x
        y = plant.C @ rest
        z = inc.W @ inc.hidden(y) + inc.U @ y + inc.b
    except (NoEquilibriumError, ConvergenceError, NotWellPosedError):
        return None
    for level, unit in zip(z, inc.activations, strict=True):
        if unit.pieces is not None and np.any(np.abs(unit.pieces.kinks - level) <= KINK * (1 + abs(level))):
            return None
    return plant.A + plant.B @ inc.jacobian(y) @ plant.C, rest


def _is_bounded(inc: INC) -> bool:
    read = np.flatnonzero(np.any(inc.V != 0, axis=0))
    return not inc.K.any() and all(np.all(np.isfinite(inc.activations[i].bounds)) for i in read)


def too_fast(plant: Plant, A: Array, growth: float) -> str:
    """Return in words that x+ = A x, or dx/dt = A x, grows clearly faster than `growth`; empty where it does not.

    >>> too_fast(Plant([[1.5]], [[1.0]]), np.array([[1.5]]), 1.0)
    'spectral radius 1.5, not below 1'
    """
    eigenvalues = np.linalg.eigvals(A)
    value = float(np.max(np.abs(eigenvalues) if plant.discrete else eigenvalues.real))
    if value <= growth + CLEAR * (1.0 + float(np.linalg.norm(A))):
        return ""
    what = "spectral radius" if plant.discrete else "an eigenvalue of real part"
    return f"{what} {value:.6g}, not below {growth:.6g}"


def point(x: Array) -> str:
    """Return an equilibrium in words.

    >>> point(np.array([-0.0, 0.5]))
    'x* = [0, 0.5]'
    """
    return "x* = [" + ", ".join(f"{value:.6g}" for value in np.round(x, 9) + 0.0) + "]"
