"""Loops of growing size for exact pieces: clipped regulators, chains of masses, ReLU nets, implicit laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inc_casadi import INC, Box, Plant, ReLU, Saturation
from inc_casadi.claims.regional import Regional


@dataclass(frozen=True, eq=False)
class Case:
    """A loop and a claim about it, with a name for the table."""

    name: str
    plant: Plant
    inc: INC
    claim: Regional


def cases() -> list[Case]:
    """Return the loops of the default run: n = 1 to 6, m = 1 to 3, q from 1 to 30."""
    return [
        *(clipped(n, m, seed) for n, m, seed in ((1, 1, 0), (2, 1, 0), (3, 1, 3), (3, 2, 1), (4, 2, 0), (5, 2, 2),
                                                 (6, 3, 0))),
        masses(2, 1.0), masses(2, 0.5), masses(3, 1.2),
        *(network(n, widths) for n, widths in ((1, (15, 15)), (2, (8,)), (2, (12, 12)), (3, (12,)), (4, (8, 5)))),
        *(implicit(n, m, q) for n, m, q in ((2, 1, 4), (2, 2, 12), (3, 2, 8), (4, 2, 6))),
    ]


def clipped(n: int, m: int, seed: int = 0) -> Case:
    """Return a random plant, unstable when the seed is even, under its regulator clipped at half its largest input.

    >>> clipped(3, 2).inc.q
    2
    """
    rng = np.random.default_rng([seed, n, m])
    A = rng.standard_normal((n, n))
    plant = Plant(A * (1.05, 0.95)[seed % 2] / np.max(np.abs(np.linalg.eigvals(A))), rng.standard_normal((n, m)))
    K = _regulator(plant)
    half = np.full(n, 0.5)
    limit = 0.5 * np.abs(K) @ half
    claim = Regional(Box(-half, half), Box(-limit, limit), np.eye(n), np.eye(m), 0.99)
    return Case(f"clipped LQR, {('unstable', 'stable')[seed % 2]}", plant, INC.saturated(K, limit), claim)


def masses(count: int, limit: float) -> Case:
    """Return masses between walls on springs, sampled every half second, with forces on the outer ones, LQR, clipped.

    >>> case = masses(2, 1.0)
    >>> case.plant.n, case.plant.m
    (4, 2)
    """
    from scipy.linalg import expm

    springs = np.diag(np.full(count, -2.0)) + np.eye(count, k=1) + np.eye(count, k=-1)
    forces = np.eye(count)[:, [0, -1]]
    rates = np.block([[np.zeros((count, count)), np.eye(count), np.zeros((count, 2))],
                      [springs, np.zeros((count, count)), forces], [np.zeros((2, 2 * count + 2))]])
    step, n = expm(0.5 * rates), 2 * count
    plant = Plant(step[:n, :n], step[:n, n:])
    box = Box(-np.ones(n), np.ones(n))
    claim = Regional(box, Box([-limit] * 2, [limit] * 2), np.eye(n), np.eye(2))
    return Case(f"{count} masses, limit {limit:g}", plant, INC.saturated(_regulator(plant), limit), claim)


def network(n: int, widths: tuple[int, ...]) -> Case:
    """Return a stable plant with one input under a random ReLU net.

    >>> network(2, (8,)).inc.q
    8
    """
    rng = np.random.default_rng([n, *widths])
    sizes = (n, *widths, 1)
    layers = [(rng.standard_normal((b, a)) / np.sqrt(a), 0.5 * rng.standard_normal(b))
              for a, b in zip(sizes, sizes[1:], strict=False)]
    inc = INC.from_layers(layers, ReLU())
    return Case(f"ReLU net {'-'.join(map(str, widths))}", _stable(rng, n, 1), _weak(inc), _about(n, 1))


def implicit(n: int, m: int, q: int) -> Case:
    """Return a stable plant under a law with ||W||_inf = 0.7, half of its units ReLU and half saturated.

    >>> implicit(2, 1, 4).inc.well_posedness().norm.__round__(12)
    0.7
    """
    rng = np.random.default_rng([n, m, q])
    W = rng.standard_normal((q, q))
    W *= 0.7 / np.abs(W).sum(axis=1).max()
    units = (ReLU(),) * (q // 2) + (Saturation(),) * (q - q // 2)
    inc = INC(W, rng.standard_normal((q, n)), rng.standard_normal((m, q)) / q, np.zeros((m, n)),
              0.5 * rng.standard_normal(q), activation=units)
    return Case("implicit, W != 0", _stable(rng, n, m), _weak(inc), _about(n, m))


def _weak(inc: INC) -> INC:
    """The law with outputs of a third, which leaves a stable loop stable."""
    return INC(inc.W, inc.U, 0.3 * inc.V, 0.3 * inc.K, inc.b, 0.3 * inc.d, inc.activation)


def _stable(rng: np.random.Generator, n: int, m: int) -> Plant:
    A = rng.standard_normal((n, n))
    return Plant(A * 0.7 / np.max(np.abs(np.linalg.eigvals(A))), rng.standard_normal((n, m)) / np.sqrt(n))


def _about(n: int, m: int) -> Regional:
    return Regional(Box(-np.ones(n), np.ones(n)), None, np.eye(n), np.eye(m), 0.95)


def _regulator(plant: Plant) -> np.ndarray:
    from scipy.linalg import solve_discrete_are

    P = solve_discrete_are(plant.A, plant.B, np.eye(plant.n), np.eye(plant.m))
    return -np.linalg.solve(np.eye(plant.m) + plant.B.T @ P @ plant.B, plant.B.T @ P @ plant.A)
