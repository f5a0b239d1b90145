"""Chains of masses on springs, pushed apart by limited forces between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inc_casadi import Box, Plant, Spec

from .paper import Case


def cases() -> dict[str, Case]:
    """Return the cases of this file by name.

    >>> sorted(cases())
    ['six masses', 'three masses']
    """
    return {"three masses": masses(3), "six masses": masses(6, ((0, 1), (2, 4), (3, 5)))}


def masses(count: int, pairs: Sequence[tuple[int, int]] | None = None) -> Case:
    """Return masses of 1 kg between walls on springs of 1 N/m: positions (m), velocities (m/s); held over 0.5 s.

    A force |u_i| <= 0.5 N acts between each two neighbours, or between the pairs. The source has six masses and three
    forces, those of the case "six masses", weights I, and is undamped: all eigenvalues are on the unit circle. Discount and
    box are chosen here.

    count: of masses; pairs: those that a force pushes apart, None for neighbours

    >>> case = masses(3)
    >>> case.plant.n, case.plant.m
    (6, 2)
    """
    springs = np.diag(np.full(count, -2.0)) + np.eye(count, k=1) + np.eye(count, k=-1)
    none, unit = np.zeros((count, count)), np.eye(count)
    between = np.column_stack([unit[i] - unit[j] for i, j in pairs or [(i, i + 1) for i in range(count - 1)]])
    A = np.block([[none, np.eye(count)], [springs, none]])
    half, limit = np.full(2 * count, 0.4), np.full(between.shape[1], 0.5)
    spec = Spec(np.eye(2 * count), np.eye(between.shape[1]), 0.98, Box(-half, half), Box(-limit, limit))
    return Case(Plant(A, np.vstack([0 * between, between]), dt=0.0).sampled(0.5), spec,
                "Wang, Boyd, IEEE TCST 18(2), 2010, the oscillating masses" + (", three of them" if count == 3 else ""))
