"""Linear baselines that share no code with the toolbox: python-control's LQR and the paper's dense search."""

from __future__ import annotations

import numpy as np

from inc_casadi import Plant, Spec
from inc_casadi.arrays import Array
from inc_casadi.errors import SolverError

ADMISSIBLE = 1e-12
ROUNDS, GRID = 12, 61


def control_lqr_gain(plant: Plant, spec: Spec) -> Array:
    """Return the discounted LQR gain K (m, n), u = K x, by python-control's dlqr of sqrt(discount) (A, B).

    Raises SolverError when python-control is missing.

    >>> from inc_casadi import Box
    >>> round(float(control_lqr_gain(Plant(2.0, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1)))[0, 0]), 6)
    -2.0
    """
    try:
        import control
    except ImportError as error:
        raise SolverError("this baseline needs python-control: pip install control") from error
    root = np.sqrt(spec.discount)
    K, _, _ = control.dlqr(root * plant.A, root * plant.B, spec.Q, spec.R)
    return -np.asarray(K)


def lyapunov_costs(plant: Plant, spec: Spec, gains: Array) -> Array:
    """Return tr(P_F S0) of eq:PF_lyap for many gains F (N, m, p) at once: (N,), infinite where the sum diverges.

    The series P_F = sum_k discount^k A_F'^k M A_F^k is summed by doubling, all gains side by side.

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 1.0, Box(-1, 1))
    >>> lyapunov_costs(Plant(1.5, 1.0), spec, np.array([[[-1.0]], [[0.0]]])).round(6).tolist()
    [0.444444, inf]
    """
    G = gains @ plant.C
    closed = np.sqrt(spec.discount) * (plant.A + plant.B @ G)
    stable = np.max(np.abs(np.linalg.eigvals(closed)), axis=1) < 1 - 1e-9
    power, P = closed[stable], spec.Q + np.swapaxes(G[stable], 1, 2) @ spec.R @ G[stable]
    for _ in range(40):
        P = P + np.swapaxes(power, 1, 2) @ P @ power
        power = power @ power
    costs = np.full(len(gains), np.inf)
    costs[stable] = np.einsum("kij,ji->k", P, spec.initial.second_moment)
    return costs


def dense_search(plant: Plant, spec: Spec) -> tuple[Array, float]:
    """Return the best gain of a dense search over two entries, and its cost: the linear benchmark of sec:numerics.

    A grid over the admissible gains, those with H_u F C v <= h_u at every vertex v, refined around its best point until
    the cells are below 1e-9 of the first ones. A search, not a proof of global optimality.

    plant: p m = 2, so that F has two entries. spec: limits |u| and an initial set with vertices.
    """
    assert spec.inputs is not None and plant.m * plant.p == 2
    rows = spec.inputs.H
    seen = plant.C @ spec.initial.vertices
    center, width = np.zeros(2), 2.0 * np.max(np.abs(spec.inputs.vertices)) / np.min(np.max(np.abs(seen), axis=1))
    best, cost = np.zeros(2), np.inf
    for _ in range(ROUNDS):
        line = np.linspace(-width, width, GRID)
        grid = center + np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        gains = grid.reshape(-1, plant.m, plant.p)
        most = np.einsum("fm,gmp,pv->gfv", rows, gains, seen).max(axis=2)
        gains = gains[np.all(most <= spec.inputs.h + ADMISSIBLE, axis=1)]
        costs = lyapunov_costs(plant, spec, gains)
        if costs.size and costs.min() < cost:
            best, cost = gains[np.argmin(costs)].ravel(), float(costs.min())
        center, width = best, 4 * width / (GRID - 1)
    return best.reshape(plant.m, plant.p), cost
