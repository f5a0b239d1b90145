"""Starts with live random hidden units: around nothing, or around a linear law that they leave as it is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.activations import Activation, ReLU
from inc_casadi.arrays import Array, matrix, number
from inc_casadi.inc import INC
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

_READOUT = 0.1  # size of the random readout, as a share of the input range: the law begins close to u = 0


def random_start(plant: Any, spec: Spec, hidden: int, activation: Activation | None = None, kappa: float = 0.95,
                 seed: int = 0) -> INC:
    """Return a random inner law v = V eta + d with K = 0 and v(0) = 0, its kinks among the initial measurements.

    ||W||_inf = kappa / 2; the rows of U are random directions over the root mean squares of the measurements, and b
    makes U_i y + b_i vanish at the measurement y of a random initial state; V is about a tenth of the input range.
    Input limits are not part of the law: `train` applies them, or `inc.with_saturated_output(box)`.

    Parameters
    ----------
    plant : Plant or control.StateSpace
    spec : Spec; its initial states place the kinks, its inputs scale V
    hidden : number of hidden units q >= 0
    activation : of all hidden units, ReLU when left out
    kappa : the norm bound of the training to come, in (0, 1)
    seed : of the random numbers

    Returns
    -------
    INC with p measurements and m outputs; a candidate, nothing is proved but its well-posedness.

    Raises
    ------
    DimensionError : the spec does not fit the plant
    InvalidInputError : hidden is negative, or kappa outside (0, 1)

    Examples
    --------
    >>> from inc_casadi import Box
    >>> spec = Spec(Q=np.eye(2), R=1.0, discount=1.0, initial=Box([-1, -2], [1, 2]))
    >>> law = random_start(Plant([[1, 1], [0, 1]], [[0], [1]]), spec, 3, seed=1)
    >>> law.q, law.well_posedness().norm < 0.5, law([0.0, 0.0]).round(12).tolist()
    (3, True, [0.0])
    """
    plant = as_plant(plant)
    rng = np.random.default_rng(seed)
    W, U, b = _units(plant, spec, hidden, kappa, rng)
    V = _READOUT * input_range(spec)[:, None] * rng.standard_normal((plant.m, hidden))
    K = np.zeros((plant.m, plant.p))
    law = INC(W, U, V, K, b, activation=activation or ReLU())
    return INC(W, U, V, K, b, -law(np.zeros(plant.p)), activation or ReLU())


def linear_start(K: ArrayLike, plant: Any, spec: Spec, hidden: int, activation: Activation | None = None,
                 kappa: float = 0.95, seed: int = 0) -> INC:
    """Return the linear law u = K y as an inner law with V = 0 and random hidden units, ready to be trained.

    The units are those of `random_start`. With measured output, K = K_lqr C^+ carries a state gain over as well as
    least squares can; nothing says that it stabilizes.

    Parameters
    ----------
    K : (m, p) gain, u = K y
    plant, spec, hidden, activation, kappa, seed : as in `random_start`

    Raises
    ------
    DimensionError : K or the spec does not fit the plant
    InvalidInputError : hidden is negative, or kappa outside (0, 1)

    Examples
    --------
    >>> from inc_casadi import Box
    >>> spec = Spec(Q=np.eye(2), R=1.0, discount=1.0, initial=Box([-1, -2], [1, 2]))
    >>> law = linear_start([[-0.4, -1.2]], Plant([[1, 1], [0, 1]], [[0], [1]]), spec, 4)
    >>> law.q, law([1.0, 0.5]).round(6).tolist()
    (4, [-1.0])
    """
    plant = as_plant(plant)
    K = matrix("K", K, (plant.m, plant.p))
    W, U, b = _units(plant, spec, hidden, kappa, np.random.default_rng(seed))
    return INC(W, U, np.zeros((plant.m, hidden)), K, b, activation=activation or ReLU())


def measurement_range(plant: Plant, spec: Spec) -> Array:
    """Return the root mean square of each initial measurement (p,); 1 for one that is zero with probability 1.

    >>> from inc_casadi import Box
    >>> measurement_range(Plant(0.5, 1.0, 2.0), Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-3, 3))).round(6).tolist()
    [3.464102]
    """
    size = np.sqrt(np.maximum(np.einsum("in,nk,ik->i", plant.C, spec.initial.second_moment, plant.C), 0.0))
    return np.where(size > 0, size, 1.0)


def input_range(spec: Spec) -> Array:
    """Return half the width of the input set along each input (m,), or ones without limits.

    >>> from inc_casadi import Box
    >>> input_range(Spec(Q=1.0, R=1.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 3))).tolist()
    [2.0]
    """
    if spec.inputs is None:
        return np.ones(spec.m)
    axes = np.eye(spec.m)
    return (np.asarray(spec.inputs.support(axes)) + np.asarray(spec.inputs.support(-axes))) / 2


def _units(plant: Plant, spec: Spec, hidden: int, kappa: float, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    spec.check(plant)
    q, kappa = whole("hidden", hidden, 0), number("kappa", kappa, 0.0, 1.0, open_low=True, open_high=True)
    W = rng.uniform(-1.0, 1.0, (q, q))
    W *= 0.5 * kappa / np.maximum(np.abs(W).sum(axis=1, keepdims=True), 1e-300)
    U = rng.standard_normal((q, plant.p))
    U = U / np.linalg.norm(U, axis=1, keepdims=True) / measurement_range(plant, spec)
    kinks = plant.C @ spec.initial.sample(q, rng)
    return W, U, -np.einsum("qp,pq->q", U, kinks)
