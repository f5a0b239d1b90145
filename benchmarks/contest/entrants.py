"""All controllers of a contest, designed one after another: the synthesized ones, then the baselines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any

from benchmarks.baselines import BASELINES
from inc_casadi.errors import InvalidInputError
from synthesis import synthesize, synthesize_dynamic
from synthesis.result import Result

from .isolation import attempted
from .settings import MEMORY, SYNTHESIZED
from .work import TOO_LATE, Design, Work, designed

STAGES = {SYNTHESIZED: "synthesis", MEMORY: "synthesis with memory"}


def entrants(work: Work) -> Iterator[Design]:
    """Yield the designs that are wanted; one that fails, in whatever way, is a design without a law.

    >>> from benchmarks.plants import scalar
    >>> from .settings import Settings
    >>> [one.name for one in entrants(Work(scalar(0.9), Settings(only=("saturated LQR",)), float("inf")))]
    ['saturated LQR']
    """
    for name, design in ((SYNTHESIZED, _static), (MEMORY, _with_memory), *((name, _baseline(name)) for name in BASELINES)):
        if work.settings.wants(name):
            with work.stages.during(STAGES.get(name, "designs")):
                found = design(work)
            yield found


def _baseline(name: str) -> Callable[[Work], Design]:
    return lambda work: designed(name, *_timed(work, partial(BASELINES[name], work.case, work.settings.seed)))


def _static(work: Work) -> Design:
    settings = work.settings
    return _read(work, designed(SYNTHESIZED, *_timed(None, partial(
        synthesize, work.case.plant, work.case.spec, hidden=settings.hidden, seconds=settings.search,
        training_seconds=settings.training, proof_seconds=settings.proof, seed=settings.seed, verbose=False))))


def _with_memory(work: Work) -> Design:
    settings, (plant, spec, _) = work.settings, work.case
    if plant.full_state:
        needless = InvalidInputError("the plant measures its full state, so that there is nothing to remember")
        return designed(MEMORY, needless, 0.0)
    return _read(work, designed(MEMORY, *_timed(work, partial(
        synthesize_dynamic, plant, spec, hidden=settings.hidden, seconds=settings.search,
        training_seconds=settings.training, proof_seconds=settings.proof, seed=settings.seed, verbose=False))))


def _read(work: Work, design: Design) -> Design:
    """The design whose law is a result, with the law of that; nothing else where there is none."""
    result, stage = design.law, STAGES[design.name]
    if result is None:
        return design
    for phase, seconds in result.seconds.items():  # as it counts them itself, in seconds of wall time
        work.stages.seconds[f"{stage}, {phase} (wall)"] = seconds
    law = result.inc if isinstance(result, Result) else result.dynamic
    reason = "; ".join(filter(None, (*result.notes, result.ended)))
    return replace(design, law=law, result=result, reason=reason, proof=result.proof)


def _timed(work: Work | None, make: Callable[[], Any]) -> tuple[Any, float]:
    """What is made, or the exception, and the processor seconds; nothing is begun when the time of the work is over."""
    begun = process_time()
    made = TOO_LATE if work is not None and work.over else attempted(make)
    return made, process_time() - begun
