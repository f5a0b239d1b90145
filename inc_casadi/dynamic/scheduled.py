"""The observer whose gains differ in its first steps: a clock among its states, and ReLU units that open the gates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..activations import ReLU
from ..arrays import Array, matrix
from ..errors import DimensionError, InvalidInputError
from ..inc import INC
from ..plant import Plant, as_plant
from ..sets import Box, Polytope
from ..spec import Spec
from .controller import DynamicINC

_WATCHED = 100  # steps after the scheduled ones whose innovations are watched
_ROOM = 2.0  # a gate is open for innovations up to this many times the largest that can come


def scheduled_observer(plant: Any, spec: Spec, readout: INC, gains: Sequence[ArrayLike], last: ArrayLike) -> DynamicINC:
    """Return the observer xhat_k = xbar_k + M_k (y_k - C xbar_k), xbar_{k+1} = A xhat_k + B u_k, with u_k = readout(xhat_k).

    M_k = gains[k] for k < T, and `last` ever after. A gain that depends on the step makes a controller time-varying, and so
    no LTI one has it; an INC does, exactly. Its state is xi = (xbar, c), c_0 = (1, 0, ..., 0) in R^T a clock, which shifts:
    c_k is 1 in place k and 0 elsewhere, and 0 from step T on. Of an innovation v = y - C xbar with |v_i| < r at all steps,

        r max(v_i / r + 2 c_j - 1, 0) - r c_j   is v_i where c_j = 1, and 0 where c_j = 0,

    so T p ReLU units add (M_j - last) v at step j alone. With e_k = x_k - xhat_k, whatever the readout does,

        x_{k+1} - xbar_{k+1} = A (I - M_k C) (x_k - xbar_k):

    the innovations depend on x_0 alone, and their largest magnitudes over the initial set are known beforehand: r is at
    least twice these, so that no motion from there meets a kink of a gate, and none of its units cuts a set of starting
    points.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : for the initial distribution, which has vertices; xbar_0 is its mean
    readout : INC of n measurements
    gains : T matrices (n, p); last : (n, p)

    Raises
    ------
    DimensionError : gains or readout do not fit the plant
    InvalidInputError : a continuous plant, or an initial distribution without vertices

    Examples
    --------
    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
    >>> spec = Spec(np.eye(2), 0.1, 0.95, Box([-1, -0.5], [1, 0.5]))
    >>> law = scheduled_observer(plant, spec, INC.linear([[0.0, -1.0]]), [[[1.0], [0.0]], [[1.0], [1.0]]], [[1.0], [0.5]])
    >>> xi, x, speeds = law.xi_0, np.array([1.0, 0.25]), []
    >>> for _ in range(3):  # the speed cannot be seen at first, and is known from the second measurement on
    ...     xi, u = law.step(xi, plant.C @ x)
    ...     x, speeds = plant.A @ x + plant.B @ u, [*speeds, 0.0 - float(u[0])]
    >>> speeds
    [0.0, 0.25, 0.0]
    """
    plant = as_plant(plant)
    if not plant.discrete:
        raise InvalidInputError("the observer counts steps, but the plant is continuous (dt = 0): use plant.sampled(dt)")
    n, p, T = plant.n, plant.p, len(gains)
    if (readout.p, readout.m) != (n, plant.m):
        raise DimensionError(f"the readout maps {readout.p} values to {readout.m} inputs, but must map the {n} of the "
                             f"estimate to {plant.m}")
    if not isinstance(spec.initial.support, Box | Polytope):
        raise InvalidInputError("the initial distribution is not one on a box or polytope, so innovations have no bound")
    tables, last = [matrix(f"gains[{k}]", gain, (n, p)) for k, gain in enumerate(gains)], matrix("last", last, (n, p))
    reach = _reach(plant, spec, [*tables, *[last] * _WATCHED])
    xhat = _Estimate(plant, last, tables, reach)
    return DynamicINC(_law(plant, readout, xhat, T), np.concatenate([spec.initial.mean, np.eye(1, T)[0]]))


class _Estimate:
    """xhat = E_y y + E_xi xi + E_eta eta over the units of the gates, with their own rows of U and b."""

    def __init__(self, plant: Plant, last: Array, gains: Sequence[Array], reach: Array) -> None:
        n, p, T = plant.n, plant.p, len(gains)
        read = np.hstack([np.eye(p), -plant.C])  # v of (y, xbar)
        self.of_measured = np.hstack([last @ read + np.eye(n, p + n, p), np.zeros((n, T))])
        rows, columns = [np.zeros((0, p + n + T))], [np.zeros((n, 0))]
        for j in range(T):
            opened, clock = (gains[j] - last) * reach, np.eye(1, T, j)[0]
            rows.append(np.hstack([read / reach[:, None], 2.0 * np.tile(clock, (p, 1))]))
            columns.append(opened)
            self.of_measured[:, p + n + j] -= opened.sum(axis=1)
        self.U, self.of_units = np.vstack(rows), np.hstack(columns)


def _law(plant: Plant, readout: INC, xhat: _Estimate, T: int) -> INC:
    g, q = xhat.U.shape[0], readout.q
    W = np.block([[np.zeros((g, g + q))], [readout.U @ xhat.of_units, readout.W]])
    U = np.vstack([xhat.U, readout.U @ xhat.of_measured])
    b = np.concatenate([-np.ones(g), readout.b])
    u = readout.K @ xhat.of_measured, np.hstack([readout.K @ xhat.of_units, readout.V]), readout.d
    after = plant.A @ xhat.of_measured + plant.B @ u[0]
    through = plant.B @ u[1] + np.hstack([plant.A @ xhat.of_units, np.zeros((plant.n, q))])
    clock = np.hstack([np.zeros((T, plant.p + plant.n)), np.eye(T, k=-1)])
    return INC(W, U, np.vstack([u[1], through, np.zeros((T, g + q))]), np.vstack([u[0], after, clock]), b,
               np.concatenate([u[2], plant.B @ u[2], np.zeros(T)]), (*(ReLU(),) * g, *readout.activations))


def _reach(plant: Plant, spec: Spec, gains: Sequence[Array]) -> Array:
    """Powers of two (p,) that are at least twice the largest |v_i| of any step: a gate is to stay closed at the others."""
    e, largest = spec.initial.vertices - spec.initial.mean[:, None], np.full(plant.p, 2.0**-20)
    for gain in gains:
        v = plant.C @ e
        largest = np.maximum(largest, np.max(np.abs(v), axis=1))
        e = plant.A @ (e - gain @ v)
    return 2.0 ** np.ceil(np.log2(_ROOM * largest))


def filter_gains(plant: Any, spec: Spec, steps: int | None = None) -> list[Array]:
    """Return the gains M_k (n, p) of the Kalman filter without noise, from the covariance of x_0, for k < steps.

    S_0 = cov x_0, M_k = S_k C'(C S_k C')^+, S_{k+1} = A (I - M_k C) S_k A': of all estimates of x_k that are affine in
    y_0, ..., y_k this one has the least mean square error in every direction. Where (A, C) is observable S_k = 0 once
    the measurements determine x_0, after n steps at most, and the gains end there.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : for the covariance of x_0
    steps : the most gains, n by default

    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
    >>> [M.round(6).tolist() for M in filter_gains(plant, Spec(np.eye(2), 0.1, 0.95, Box([-1, -0.5], [1, 0.5])))]
    [[[1.0], [0.0]], [[1.0], [1.0]]]
    """
    plant = as_plant(plant)
    S, gains = np.asarray(spec.initial.covariance, dtype=float), []
    size = np.trace(S)
    for _ in range(plant.n if steps is None else steps):
        if np.trace(S) <= 1e-12 * size:
            break
        seen = plant.C @ S @ plant.C.T
        M = S @ plant.C.T @ np.linalg.pinv(seen, rcond=1e-10, hermitian=True)
        gains.append(M)
        left = np.eye(plant.n) - M @ plant.C
        S = plant.A @ left @ S @ left.T @ plant.A.T
    return gains
