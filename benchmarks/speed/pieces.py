"""How many pieces an exact walk takes, how long, in how much memory, against n, m and q; beside the other ways there are."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from inc_casadi import Spec
from inc_casadi.estimate import estimate
from inc_casadi.pieces.cell_walk import CellWalk, cell_walk
from inc_casadi.pieces.walk import Budget, walk
from inc_casadi.regional_certificate import RegionalCertificate, certify_region

from .pieces_cases import Case, cases

WALK = Budget(pieces=100_000, steps=2_000, seconds=10.0)
SIMPLICES = Budget(pieces=100_000, steps=2_000, seconds=1.0)
MOST_PROVED = 5_000  # vertices; a proof of more takes too long for a table
FEW, MANY, MOMENT = 1_000, 10_000, 0.15  # samples of a timed batch; the larger one where the smaller is a moment's work
ACCURACY = 1e-4


@dataclass(frozen=True)
class PiecesRow:
    """One loop: its size, what the walk over polytopes took, and what takes its place.

    pieces: polytopes at the end; steps: of the longest motion; walk, cost, proof: seconds, proof NaN where it was not
    tried; proved: by what, "" when not; memory: the walk's peak in MB; sampling: seconds of Monte Carlo to a standard
    error of 1e-4 of the mean, extrapolated; simplices: how many the walk over simplices took, and its seconds;
    ended: the budget that stopped the walk over polytopes; capped: whether simplices were stopped by theirs; off: by how
    many standard errors the sampled mean is off.
    """

    name: str
    n: int
    m: int
    q: int
    pieces: int
    steps: int
    walk: float
    cost: float
    proof: float
    proved: str
    memory: float
    sampling: float
    simplices: int
    simplices_seconds: float
    ended: str
    capped: bool
    off: float


def pieces(which: Iterable[Case] | None = None) -> list[PiecesRow]:
    """Return one row for each loop, the default ones when none are given."""
    return [_measured(case) for case in (cases() if which is None else which)]


def _measured(case: Case) -> PiecesRow:
    start = time.perf_counter()
    certificate = certify_region(case.plant, case.inc, case.claim, WALK)
    found = certificate.walk
    assert found is not None, certificate.reason
    walked = time.perf_counter() - start
    start = time.perf_counter()
    expected = found.expected if found.complete else np.nan
    cost = time.perf_counter() - start
    proof, proved = _proof(certificate, found)
    needed, off = _sampling(case, expected)
    simplices, seconds, capped = _simplices(certificate)
    return PiecesRow(case.name, case.plant.n, case.plant.m, case.inc.q, len(found.arrived) + len(found.alive),
                     int(found.steps_taken.max(initial=0)), walked, cost, proof, proved, _memory(certificate),
                     needed, simplices, seconds, found.ended, capped, off)


def _proof(certificate: RegionalCertificate, found: CellWalk) -> tuple[float, str]:
    """Seconds and method of `prove`; NaN where the walk is too long to be proved in a moment."""
    if len(found.arrived.owner) > MOST_PROVED or not certificate.holds():
        return np.nan, ""
    proof = certificate.prove()
    return proof.seconds, proof.method if proof.succeeded else ""


def _memory(certificate: RegionalCertificate) -> float:
    """The peak of another walk's arrays in MB; counting slows it down, so that it is not timed."""
    loop, terminal = certificate._setting
    assert terminal is not None
    tracemalloc.start()
    try:
        cell_walk(loop, certificate.claim, terminal, replace(certificate.budget, seconds=3 * WALK.seconds))
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def _sampling(case: Case, expected: float) -> tuple[float, float]:
    """Seconds of sampling to the accuracy, and by how many standard errors a small sample's mean is off."""
    claim = case.claim
    spec = Spec(claim.Q, claim.R, claim.discount, claim.initial, claim.inputs)
    seconds = np.inf
    for samples in (FEW, MANY):
        start = time.perf_counter()
        run = estimate(case.plant, case.inc, spec, samples=samples)
        seconds = time.perf_counter() - start
        if seconds > MOMENT:
            break
    return seconds * (run.standard_error / (ACCURACY * run.mean)) ** 2, (run.mean - expected) / run.standard_error


def _simplices(certificate: RegionalCertificate) -> tuple[int, float, bool]:
    loop, terminal = certificate._setting
    assert terminal is not None
    found = walk(loop, certificate.claim, terminal, SIMPLICES)
    return len(found.done) + len(found.left), found.seconds, not found.complete


def pieces_table(rows: list[PiecesRow]) -> str:
    """Return the rows as text. The ratios are to the walk with its cost, in the same run; > where a cap was met."""
    lines = [f"{'loop':<24} {'n':>2} {'m':>2} {'q':>3} {'pieces':>7} {'steps':>5} {'walk s':>7} {'cost s':>7} "
             f"{'proof s':>8} {'MB':>6} {'off':>5} {'sampling / ours':>15} {'simplices':>10} {'theirs / ours':>13}"]
    for row in rows:
        ours, more = row.walk + row.cost, ">" if row.capped else ""
        proof = "-" if np.isnan(row.proof) else f"{row.proof:.3f}" + ("" if row.proved else "!")
        mark = "*" if row.ended else ""
        lines.append(f"{row.name:<24} {row.n:>2} {row.m:>2} {row.q:>3} {row.pieces:>6}{mark or ' '} {row.steps:>5} "
                     f"{row.walk:>7.3f} {row.cost:>7.3f} {proof:>8} {row.memory:>6.1f} {row.off:>5.1f} "
                     f"{row.sampling / ours:>15.0f} {more + str(row.simplices):>10} "
                     f"{more + f'{row.simplices_seconds / ours:.1f}':>13}")
    return "\n".join([*lines, "", *_NOTES])


_NOTES = (
    "proof: of every bound, with all rounding bounded; - not tried, ! not proved; * the budget ended the walk",
    f"off: the mean of {FEW} or {MANY} samples less ours, in standard errors",
    f"sampling: to a standard error of {ACCURACY:g} of the mean, extrapolated from that batch",
    f"simplices: the walk that cuts simplices instead; > stopped at {SIMPLICES.seconds:g} s or {SIMPLICES.pieces} of them",
)
