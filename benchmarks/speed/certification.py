"""How fast a cost certificate is found and proved: by our interior-point method, by Clarabel, by CVXPY with Clarabel."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from inc_casadi import INC, DiscountedCost, Gaussian, Plant, Tanh
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.lmi_cvxpy import cvxpy_search
from inc_casadi.lmi_search import search
from inc_casadi.multipliers import Multiplier, Sector, Slope

from .measurement import Measurement

SIZES = ((4, 8), (10, 32), (10, 64), (30, 200))
LARGEST_CVXPY = 74  # n + q; beyond, CVXPY with Clarabel takes minutes and gigabytes
LARGEST_DIRECT = 90
SHORT, TIMES = 1.0, 5  # a search shorter than this many seconds is timed this often, and its median is taken
Way = Callable[[Plant, INC, DiscountedCost], MatrixCertificate]
TARGET_RATIO, TARGET_LARGEST, TARGET_PROOF = 50.0, 10.0, 100.0


@dataclass(frozen=True)
class Row:
    """One certificate: the problem, who searched, seconds, the bound, and the largest eigenvalue of the LMI at its numbers.

    eigenvalue: of -(decrease), negative where the inequality holds strictly; proved: whether `prove` succeeds; proof:
    its milliseconds from the stored numbers alone.
    """

    n: int
    q: int
    multiplier: str
    solver: str
    seconds: float
    bound: float
    eigenvalue: float
    proved: bool
    proof: float


def problem(n: int, q: int, seed: int = 0) -> tuple[Plant, INC, DiscountedCost]:
    """Return a stable plant with n states, an implicit tanh law with q units, ||W||_inf = 0.5, and a discounted cost.

    >>> problem(3, 5)[1].q
    5
    """
    rng, m, p = np.random.default_rng(seed), 2, 3
    A = rng.normal(size=(n, n))
    plant = Plant(0.9 * A / np.max(np.abs(np.linalg.eigvals(A))), rng.normal(size=(n, m)),
                  rng.normal(size=(p, n)) / np.sqrt(n))
    W = rng.normal(size=(q, q))
    inc = INC(0.5 * W / np.abs(W).sum(axis=1).max(), rng.normal(size=(q, p)), 0.1 * rng.normal(size=(m, q)) / q,
              np.zeros((m, p)), activation=Tanh())
    return plant, inc, DiscountedCost(np.eye(n), np.eye(m), 0.95, Gaussian(np.zeros(n), np.eye(n)))


def certification(sizes: tuple[tuple[int, int], ...] = SIZES, *, reference: bool = True) -> list[Row]:
    """Return one row for each size and solver; sizes that a solver cannot do in reasonable time are left out for it.

    reference: whether CVXPY is measured too.
    """
    rows = []
    for n, q in sizes:
        for multiplier in (Sector(), *((Slope(),) if q <= 8 else ())):
            rows += [_measured(n, q, multiplier, name, way) for name, way in _ways(n, q, multiplier, reference)]
    return rows


def _ways(n: int, q: int, multiplier: Multiplier, reference: bool) -> list[tuple[str, Way]]:
    def by(solver: str) -> Way:
        return lambda plant, inc, claim: search(plant, inc, claim, multiplier, solver=solver)

    ways = [("interior point", by("interior point"))]
    if n + q <= LARGEST_DIRECT:
        ways.append(("Clarabel, direct", by("clarabel")))
    if reference and n + q <= LARGEST_CVXPY:
        ways.append(("CVXPY + Clarabel", lambda plant, inc, claim: cvxpy_search(plant, inc, claim, multiplier)[0]))
    return ways


def _measured(n: int, q: int, multiplier: Multiplier, name: str, way: Way) -> Row:
    parts = problem(n, q)
    durations: list[float] = []
    if n + q <= 20:
        way(*parts)  # the first call pays for imports
    while not durations or (max(durations) < SHORT and len(durations) < TIMES):
        start = time.perf_counter()
        found = way(*parts)
        durations.append(time.perf_counter() - start)
    seconds = median(durations)
    fresh = replace(found)  # nothing kept from the search
    proof = fresh.prove("float")
    return Row(n, q, multiplier.name, name, seconds, found.bound, _largest_eigenvalue(found), bool(proof),
               1e3 * proof.seconds)


def _largest_eigenvalue(found: MatrixCertificate) -> float:
    """Return the largest eigenvalue of the negated conditions, computed plainly."""
    from inc_casadi.inequalities import Inequalities
    parts = Inequalities(found.loop, found.claim, found.multiplier)
    return -min(float(np.linalg.eigvalsh(condition)[0]) for condition in parts.conditions(found.values).values())


def certification_table(rows: list[Row]) -> str:
    """Return the rows as text, each solver beside its ratio to our own."""
    lines = [f"{'n':>3} {'q':>4}  {'rung':<7} {'solver':<17} {'seconds':>8} {'ratio':>7} {'bound':>13} {'LMI max eig':>12} "
             f"{'proved':>6} {'proof ms':>8}"]
    ours = {(row.n, row.q, row.multiplier): row.seconds for row in rows if row.solver == "interior point"}
    for row in rows:
        ratio = row.seconds / ours[row.n, row.q, row.multiplier]
        lines.append(f"{row.n:>3} {row.q:>4}  {row.multiplier:<7} {row.solver:<17} {row.seconds:>8.3f} {ratio:>7.1f} "
                     f"{row.bound:>13.8g} {row.eigenvalue:>12.2e} {'yes' if row.proved else 'no':>6} {row.proof:>8.1f}")
    return "\n".join(lines)


def certification_targets(rows: list[Row]) -> list[Measurement]:
    """Return the figures that have targets: the ratio at (10, 64), the time at (30, 200), the proof at (10, 64)."""
    at = {(row.n, row.q, row.solver): row for row in rows if row.multiplier == "sector"}
    found = []
    if (10, 64, "CVXPY + Clarabel") in at:
        ratio = at[10, 64, "CVXPY + Clarabel"].seconds / at[10, 64, "interior point"].seconds
        found.append(Measurement("(10, 64): our time over 1/50 of CVXPY + Clarabel's", TARGET_RATIO / ratio, "x", 1.0,
                                 f"{ratio:.0f} times faster in this run"))
    if (30, 200, "interior point") in at:
        found.append(Measurement("(30, 200) by the interior-point method", at[30, 200, "interior point"].seconds, "s",
                                 TARGET_LARGEST))
    if (10, 64, "interior point") in at:
        row = at[10, 64, "interior point"]
        found.append(Measurement("rigorous proof of the (10, 64) certificate", row.proof, "ms", TARGET_PROOF,
                                 "proved" if row.proved else "NOT PROVED"))
    return found
