"""How fast a controller answers: NumPy with Newton or Picard steps, and its CasADi Function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from inc_casadi import INC

from .measurement import Measurement, repeated

SIZES, POINTS, NORM = (8, 32, 128), 1000, 0.9
MEASUREMENTS, OUTPUTS = 4, 2


def random_law(q: int, seed: int = 0, norm: float = NORM) -> INC:
    """Return a ReLU law with a full W, ||W||_inf = norm, for 4 measurements and 2 outputs.

    >>> round(random_law(8).well_posedness().norm, 12)
    0.9
    """
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((q, q))
    W *= norm / np.max(np.sum(np.abs(W), axis=1))
    return INC(W, rng.standard_normal((q, MEASUREMENTS)), rng.standard_normal((OUTPUTS, q)) / q,
               rng.standard_normal((OUTPUTS, MEASUREMENTS)), 0.5 * rng.standard_normal(q))


def evaluation(sizes: tuple[int, ...] = SIZES) -> list[Measurement]:
    """Return microseconds per point, of 1000 points at once and, for one point alone, per call."""
    y = np.random.default_rng(1).standard_normal((MEASUREMENTS, POINTS))
    return [row for q in sizes for row in _compared([_measured(f"evaluate, q = {q}, {name}", answer, y)
                                                     for name, answer in _ways(random_law(q))])]


def _compared(rows: list[Measurement]) -> list[Measurement]:
    """The rows with their ratios to the least."""
    least = min(row.value for row in rows)
    return [replace(row, note=f"{row.value / least:.1f} times the fastest; {row.note}") for row in rows]


def _ways(law: INC) -> list[tuple[str, Callable[[np.ndarray], object]]]:
    return [("Newton", partial(law.solve, method="newton")), ("Picard", partial(law.solve, method="picard")),
            ("CasADi", law.to_casadi())]


def _measured(name: str, answer: Callable[[np.ndarray], object], y: np.ndarray) -> Measurement:
    many, _ = repeated(partial(answer, y), 3)
    single, _ = repeated(partial(answer, y[:, 0]), 15)
    return Measurement(name, 1e6 * many / y.shape[1], "us/point", None, f"{1e6 * single:.0f} us for one alone")
