"""The observer with an implicit readout, and what separates in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, matrix, symmetric
from ..errors import DimensionError, InfeasibleError, InvalidInputError
from ..inc import INC
from ..linear.regulator import discounted_lqr
from ..plant import Plant, as_plant
from ..sets import Box
from ..spec import Spec
from .controller import DynamicINC


def observer(plant: Any, L: ArrayLike, inc: INC, xi_0: ArrayLike | None = None) -> DynamicINC:
    """Return the observer xhat+ = A xhat + B u + L (y - C xhat) with the readout u = inc(xhat), or u = inc(y, xhat).

    xi = xhat, and in the law A_c = A - L C + B K_xhat, B_c = L + B K_y, E_c = B V, a_c = B d: the observer knows the input
    as it is, limits of the readout included. With the error e = x - xhat, whatever the readout does,

        e+ = (A - L C) e,                                                                                       (1)
        xhat+ = A xhat + B inc(xhat) + L C e:                                                                   (2)

    the error runs by itself, and the estimate is the loop of the full state under inc, driven by L C e. For u = inc(xhat)
    therefore:

    * If A - L C is stable and some P > 0, rho < 1 have |A x + B inc(x)|_P <= rho |x|_P for all x, |x|_P^2 = x'P x, then
      (x, xhat) -> 0 from everywhere: |xhat_{k+1}|_P <= rho |xhat_k|_P + |L C e_k|_P, and e_k dies out. Such P and rho are
      what `certify(Plant(A, B), inc, Stability())` certifies with a multiplier "sector", "slope" or "relu". Sufficient.
    * Where inc is bounded and the plant unstable this holds in a set only: {|xhat|_P <= 1} is kept as long as
      |L C e_k|_P <= 1 - rho. The extended plant asks for no such detour: `from_set` and Attraction speak of (x, xhat).
    * Costs do not separate: the expected cost is that of the pair, on the extended plant.

    For u = inc(y, xhat) = inc(C xhat + C e, xhat) the error enters the readout too, and (2) needs inc to be Lipschitz.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    L : (n, p)
    inc : readout of n measurements (xhat), or of p + n (y, xhat)
    xi_0 : (n,) the first estimate, None for zero

    Raises
    ------
    DimensionError : L, the readout or xi_0 do not fit the plant
    InvalidInputError : a continuous plant

    Notes
    -----
    B K, B V and A - L C are rounded: the controller is the one of the stored floats, close to the observer named; what is
    certified on the extended plant is certified of these floats.

    Examples
    --------
    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
    >>> held = observer(plant, [[1.0], [0.25]], INC.saturated([[-0.5, -1.0]], 1.0))
    >>> xi, u = held.step(held.xi_0, [4.0])
    >>> xi.tolist(), held.step(xi, [4.0])[1].tolist()
    ([4.0, 1.0], [-1.0])
    """
    plant = as_plant(plant)
    if not plant.discrete:
        raise InvalidInputError("the observer counts steps, but the plant is continuous (dt = 0): use plant.sampled(dt)")
    n, p = plant.n, plant.p
    L = matrix("L", L, (n, p))
    if inc.m != plant.m or inc.p not in (n, p + n):
        raise DimensionError(f"the readout maps {inc.p} values to {inc.m} inputs, but must map the {n} of the estimate, or "
                             f"these after the {p} of the measurement, to {plant.m}")
    K, U = (part if inc.p == p + n else np.hstack([np.zeros((len(part), p)), part]) for part in (inc.K, inc.U))
    gain = np.vstack([K, np.hstack([L, plant.A - L @ plant.C]) + plant.B @ K])
    law = INC(inc.W, U, np.vstack([inc.V, plant.B @ inc.V]), gain, inc.b, np.concatenate([inc.d, plant.B @ inc.d]),
              inc.activations)
    return DynamicINC(law, np.zeros(n) if xi_0 is None else xi_0)


def corrected(readout: INC, M: ArrayLike, C: ArrayLike) -> INC:
    """Return the law (y, xhat) -> readout(xhat + M (y - C xhat)): an estimate that counts the present measurement too.

    Parameters
    ----------
    readout : of n measurements; M : (n, p); C : (p, n) of the plant

    >>> corrected(INC.linear([[1.0, 2.0]]), [[1.0], [0.5]], [[1.0, 0.0]]).K.tolist()
    [[2.0, -1.0, 2.0]]
    """
    C = matrix("C", C, (None, readout.p))
    M = matrix("M", M, (readout.p, C.shape[0]))
    mix = np.hstack([M, np.eye(readout.p) - M @ C])
    return INC(readout.W, readout.U @ mix, readout.V, readout.K @ mix, readout.b, readout.d, readout.activations)


def observer_gain(plant: Any, process: ArrayLike, measurement: ArrayLike) -> Array:
    """Return the gain L (n, p) of the steady Kalman predictor, the regulator of the dual plant (A', C').

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    process : (n, n) covariance of a disturbance of the state per step; measurement : (p, p) of the measurement

    Raises
    ------
    InfeasibleError : the output does not show an unstable mode
    SolverError : the Riccati equation has no stabilizing solution

    >>> L = observer_gain(Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]]), [[1, 0], [0, 1]], 1.0)
    >>> L.round(4).tolist()
    [[1.2439], [0.4221]]
    """
    plant = as_plant(plant)
    modes = plant.undetectable_modes()
    if modes:
        raise InfeasibleError(f"the output does not show the mode {modes[0]:.6g}, which is not stable, so no observer can "
                              "follow it: measure more")
    Q, R = symmetric("process", process, plant.n, "semi"), symmetric("measurement", measurement, plant.p, "semi")
    dual = Plant(plant.A.T, plant.C.T, dt=plant.dt)
    return -discounted_lqr(dual, Spec(Q, R, 1.0, Box(-np.ones(plant.n), np.ones(plant.n))))[0].T
