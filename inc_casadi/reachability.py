"""What no controller can do: bring a state back that the limited inputs are too weak to hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from .arrays import Array
from .plant import Plant, as_plant
from .sets import Distribution, Gaussian
from .sets.farthest import farthest
from .spec import Spec

_EVIDENCE = 1e-7  # relative excess that counts as one
_BOUNDARY_TOL = 1e-12  # relative distance within which an eigenvalue is on the stability boundary
_PHASES, _TERMS = 64, 2000


def uncontrollable_vertex(plant: Any, spec: Spec) -> str | None:
    """Return why some initial state cannot be steered to the origin by any controller, or None if nothing is found.

    Discrete time, w'A = lambda w' with |lambda| > 1: w'x_{k+1} = lambda w'x_k + w'B u_k, hence

        lambda^-k w'x_k = w'x_0 + sum_{j<k} lambda^-(j+1) w'B u_j.

    If x_k stays bounded, the left side vanishes, so w'x_0 = -sum_j lambda^-(j+1) w'B u_j. Taking the real part of both
    sides times exp(-i theta), the right side is at most the sum of the largest values over the limits:

        Re(e^(-i theta) w'x_0) <= sum_j max over u in the limits of Re(-e^(-i theta) lambda^-(j+1) w'B u).

    For real lambda > 1 that is w'x_0 <= max(-w'Bu) / (lambda - 1), and the same for -w. Continuous time, Re lambda > 0:
    the sum becomes the integral of exp(-lambda t), bounded by max|w'Bu| / Re lambda when lambda is not real.

    Parameters
    ----------
    plant : Plant or control.StateSpace
    spec : Spec; its initial distribution and input limits are read, its cost is not

    Returns
    -------
    One sentence naming the initial state, the eigenvalue, what is needed and what is there. None proves nothing: the
    condition is necessary. For the origin to be reached it must even hold strictly; an excess within 1e-7
    relative is let pass.

    Raises
    ------
    DimensionError : spec does not fit the plant

    Notes
    -----
    Source: the null-controllable region of a plant with bounded inputs is bounded in the directions of its unstable
    modes; see the books on actuator saturation.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> plant, limits = Plant(1.5, 1.0), Box(-1, 1)
    >>> uncontrollable_vertex(plant, Spec(1.0, 0.0, 1.0, Box(-1.99, 1.99), limits)) is None
    True
    >>> print(uncontrollable_vertex(plant, Spec(1.0, 0.0, 1.0, Box(-1, 2.5), limits)))
    No controller can steer the initial state [2.5] to the origin: along the unstable mode with eigenvalue 1.5 the
    inputs can make up for at most 2, but 2.5 is needed.
    """
    plant = as_plant(plant)
    spec.check(plant)
    eigenvalues, W = np.linalg.eig(plant.A.T)  # A'w = lambda w, so that w'A = lambda w' without conjugation
    for value, w in zip(eigenvalues, W.T, strict=True):
        if value.imag >= 0 and _unstable(plant, complex(value)):
            found = _obstruction(plant, spec, complex(value), w)
            if found:
                return found
    return None


def _unstable(plant: Plant, value: complex) -> bool:
    # Beyond doubt: A is not within rounding of a matrix whose eigenvalue of that phase is on the boundary. A chain of
    # integrators has computed eigenvalues well outside the unit circle, and yet can be steered from everywhere.
    if not (abs(value) > 1 if plant.discrete else value.real > 0):
        return False
    boundary = value / abs(value) if plant.discrete else 1j * value.imag
    sizes = np.linalg.svd(plant.A - boundary * np.eye(plant.n), compute_uv=False)
    return bool(sizes[-1] > _BOUNDARY_TOL * (np.linalg.norm(plant.A) + 1))


def _obstruction(plant: Plant, spec: Spec, value: complex, w: Array) -> str | None:
    # The phases that occur for a real mode are 0 and pi; for a complex one some are tried.
    turns = np.array([1.0, -1.0]) if value.imag == 0 else np.exp(2j * np.pi * np.arange(_PHASES) / _PHASES)
    directions = np.real(np.conj(turns)[None, :] * w[:, None])
    if isinstance(spec.initial, Gaussian):
        needed, states = _gaussian(spec.initial, directions)
    else:
        states = farthest(spec.initial, directions)
        needed = np.sum(directions * states, axis=0)
    there = _available(plant, spec, value, w, turns)
    if not np.all(np.isfinite(there)):
        return None
    sizes = np.linalg.norm(w) * np.linalg.norm(np.where(np.isfinite(states), states, 0.0), axis=0)
    excess = needed - there - _EVIDENCE * np.abs(there) - 1e-9 * sizes
    worst = int(np.argmax(excess))
    if not excess[worst] > 0:
        return None
    shown = f"{value.real:.6g}" if value.imag == 0 else f"{value.real:.6g} {value.imag:+.6g}i"
    which = _named(states[:, worst]) if np.all(np.isfinite(states[:, worst])) else "far out in the Gaussian's tails"
    amount = f"{needed[worst]:.6g}" if np.isfinite(needed[worst]) else "any amount"
    return (f"No controller can steer the initial state {which} to the origin: along the unstable mode with eigenvalue "
            f"{shown} the inputs can make up for at most {there[worst]:.6g}, but {amount} is needed.")


def _named(state: Array) -> str:
    return "[" + ", ".join(f"{entry:.6g}" for entry in state) + "]"


def _gaussian(initial: Distribution, directions: Array) -> tuple[Array, Array]:
    # Some draws of a Gaussian lie beyond every bound, unless it has no variance in that direction.
    spread = np.sum(directions * (initial.covariance @ directions), axis=0)
    unbounded = spread > 1e-18 * np.sum(directions**2, axis=0) * np.trace(initial.covariance)
    needed = np.where(unbounded, np.inf, initial.mean @ directions)
    return needed, np.where(unbounded, np.inf, initial.mean[:, None])


def _available(plant: Plant, spec: Spec, value: complex, w: Array, turns: Array) -> Array:
    # An upper bound, for each phase, on what all inputs of the future together can contribute.
    across = w @ plant.B
    if np.linalg.norm(across) <= 1e-13 * np.linalg.norm(w) * np.linalg.norm(plant.B):
        return np.zeros(len(turns))
    if spec.inputs is None:
        return np.full(len(turns), np.inf)
    if value.imag == 0 and value.real > 0:
        pushes = np.real(-np.conj(turns)[None, :] * across[:, None])
        return np.asarray(spec.inputs.support(pushes)) / (value.real - 1 if plant.discrete else value.real)
    most = float(np.max(np.abs(across @ spec.inputs.vertices)))
    if not plant.discrete:
        return np.full(len(turns), most / value.real)
    count = int(min(_TERMS, 1 + np.ceil(40 / np.log(abs(value)))))
    factors = value ** -np.arange(1.0, count + 1)
    phases = -np.conj(turns)[:, None] * factors
    pushes = np.real(across[:, None, None] * phases)
    sums = np.asarray(spec.inputs.support(pushes.reshape(plant.m, -1))).reshape(len(turns), count).sum(axis=1)
    return sums + most * abs(value) ** -float(count) / (abs(value) - 1)
