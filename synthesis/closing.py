"""What ends a synthesis, of laws with memory and without: the rigorous proof, remarks on the search, times."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from inc_casadi.certificate import Certificate, Proof
from inc_casadi.dynamic import DynamicCertificate
from inc_casadi.estimate import Estimate
from inc_casadi.regional_certificate import RegionalCertificate

from .progress import Progress

if TYPE_CHECKING:
    from .dynamic_result import DynamicAttempt
    from .result import Attempt


def ordeal(run: Estimate | None) -> tuple[bool, bool, float]:
    """Return what a simulation has against a controller: no rest, a limit exceeded, the cost."""
    assert run is not None
    return not run.settled, run.excess > 1e-9, run.mean


def remarks(history: Sequence[Attempt] | Sequence[DynamicAttempt], best: Attempt | DynamicAttempt | None,
            ended: str) -> list[str]:
    """Return what a reader must know besides: interruptions, time limits, and all reasons where nothing is certified."""
    notes = [ended] if ended.startswith(("interrupted", "the executor")) else []
    if best is None or not best.certified:
        notes += [f"{one.name}: {reason}" for one in history if one is not best
                  for reason in ([one.note] if one.verdict is None else one.verdict.refusals)]
    timed = [one.name for one in history if one.timed]
    if timed:
        notes.append(f"cut short by a time limit, so that another machine may find another answer: {'; '.join(timed)}")
    return notes


def settled(certificate: Certificate | None, limit: float | None, notes: list[str], progress: Progress) -> Proof | None:
    """Settle a certificate rigorously, within a time limit where pieces are; None without one, or where interrupted."""
    if certificate is None:
        return None
    progress.say("settling the proof rigorously")
    try:
        with progress.during("the rigorous proof"):
            walked = isinstance(certificate, RegionalCertificate | DynamicCertificate)  # the others take moments
            proof = certificate.prove(limit) if walked else certificate.prove()  # type: ignore[call-arg]
    except KeyboardInterrupt:
        notes.append("interrupted while the proof was settled rigorously: it holds in floating point")
        return None
    progress.say(f"proved rigorously: {proof.method}" if proof else f"not settled rigorously: {proof.reason}")
    return proof


@contextmanager
def phase(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Put the wall time of a block into a table."""
    start = time.monotonic()
    yield
    seconds[name] = time.monotonic() - start
