"""What y_0, ..., y_k tell of the initial state, in exact arithmetic, and a first price on foreseeing the rest."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..pieces.linear import identity
from ..plant import Plant
from ..spec import Spec
from .exact_anchors import Span
from .moves import costates, slopes


def first_shown(plant: Plant) -> np.ndarray:
    """Return (n,) how many of y_0, y_1, ... do not depend on each coordinate of x_0: the first k with C A^k e_i != 0, or n.

    Exactly, of the stored floats: a measurement without noise shows whatever it depends on.

    >>> first_shown(Plant([[1.0, 0.1], [0.0, 0.9]], [[0.0], [1.0]], C=[[1.0, 0.0]])).tolist()
    [0, 1]
    """
    rows, A = exact(plant.C), exact(plant.A)
    found = np.full(plant.n, plant.n)
    for k in range(plant.n):
        found[(found == plant.n) & np.any(rows != 0, axis=0)] = k
        rows = rows @ A
    return found


def unseen(plant: Plant) -> list[np.ndarray]:
    """Return bases Z_0, Z_1, ... (n, d_k) of Fractions of what y_0, ..., y_k do not tell: [C; CA; ...; CA^k] Z_k = 0.

    Ended where nothing is left unknown, so that d_k > 0, or after n.

    >>> [Z.astype(float).tolist() for Z in unseen(Plant([[1.0, 0.5], [0.0, 1.0]], [[0.0], [1.0]], C=[[1.0, 0.0]]))]
    [[[0.0], [1.0]]]
    """
    Z, found = identity(plant.n, exact(plant.A)), list[np.ndarray]()
    rows, A = exact(plant.C), exact(plant.A)
    for _ in range(plant.n):
        Z = Z @ null_space(rows @ Z)
        if not Z.shape[1]:
            break
        found.append(Z)
        rows = rows @ A
    return found


def null_space(rows: np.ndarray) -> np.ndarray:
    """Return a basis (n, d) of the vectors that rows (r, n) of Fractions send to zero, with an identity in d of its rows.

    >>> null_space(exact(np.array([[1.0, 2.0]]))).astype(float).tolist()
    [[-2.0], [1.0]]
    """
    n = rows.shape[1]
    span = Span(rows, list(range(n)))
    others = [j for j in range(n) if j not in span.basis]
    Z, shares = identity(n, rows)[:, others], span.coefficients(rows[:, others])
    assert shares is not None  # every column is a combination of those in the basis
    Z[span.basis] = -shares
    return Z


def information_price(plant: Plant, spec: Spec, P: Array) -> Array:
    """Return Pi (r, m, n), a first price (Pi_k (x_0 - mean))'u_k on foreseeing what y_0, ..., y_k do not show.

    It is that of the best controller without limits if all coordinates of x_0 but those that y_0..y_k do not depend on were
    shown to it, which is u_k = K (x_k - A^k (what is not shown)). For x_0 = e_i that is u_k = 0 until x_i is shown and
    u_k = K x_k afterwards, and Pi_k e_i is minus the gradient of the cost there: with this price foreseeing gains nothing.

    Parameters
    ----------
    P : (n, n) cost to go without limits

    >>> from inc_casadi import Box, Plant, Spec
    >>> integrator = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.0], [1.0]], C=[[1.0, 0.0]])
    >>> information_price(integrator, Spec(np.eye(2), 1.0, 1.0, Box([-1, -1], [1, 1])), np.eye(2)).tolist()
    [[[0.0, -2.0]]]
    """
    shown = first_shown(plant)
    price = np.zeros((int(np.max(shown)), plant.m, plant.n))
    for i in np.flatnonzero(shown):
        x = np.eye(plant.n)[:, i:i + 1]
        states = np.stack([np.linalg.matrix_power(plant.A, k) @ x for k in range(shown[i] + 1)])
        idle = np.zeros((shown[i], plant.m, 1))
        gradient = slopes(plant.B, spec.R, spec.discount, idle, costates(plant.A, spec.Q, P, spec.discount, states))
        price[:shown[i], :, i] = -gradient[:, :, 0]
    return price
