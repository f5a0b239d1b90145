"""What to try next (Algorithm 1, step 4): a retry for each refusal by its reason, and improvements on what is certified."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inc_casadi import ReLU
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.linear import UnswitchedCost

from .attempts import AS_IT_IS, CERTIFIED, TRAINED, Task, cut_into_pieces, with_room
from .causes import Cause, first_of
from .readout import built_in
from .registry import may_suit
from .result import Attempt

TIGHTER, SHORTEST = 0.8, 15
MOST_UNITS = 32
OTHER_STARTS = (("seldom clipped gain", AS_IT_IS), ("MPC", AS_IT_IS), ("sector inequality", AS_IT_IS),
                ("explicit MPC", AS_IT_IS), ("compressed MPC", TRAINED))
_CALMER = {"clipped gain": "halfway gain", "stabilizing gain": "halfway gain", "halfway gain": "certified linear"}
_FEWER_CLIPPED = {"clipped LQR": "halfway gain", "clipped gain": "halfway gain", "halfway gain": "static gain",
                  "static gain": "seldom clipped gain"}


@dataclass(frozen=True, eq=False)
class Done:
    """A task and what came of it."""

    task: Task
    attempt: Attempt


def best_certified(history: Sequence[Done]) -> Done | None:
    """Return the certified attempt with the lowest cost, the earliest of equals, or None."""
    return min((one for one in history if one.attempt.certified), key=cost_of, default=None)


def cost_of(one: Done) -> float:
    """The certified cost of an attempt, infinite without."""
    return np.inf if one.attempt.verdict is None else one.attempt.verdict.cost


def repairs(history: Sequence[Done], latest: Sequence[Done]) -> tuple[Task, ...]:
    """Return a retry for every attempt of the latest round that was refused for a reason that something helps against.

    not well posed                 kappa tightened
    unstable at rest               begin with a gain that stabilizes
    motions lost or slow           begin with the best certified law, or a gain clipped less often, on a longer horizon
    too many pieces, too slow      half the units and a tighter kappa; without units, a gain clipped less often
    an input limit exceeded        train within 0.98 of the limits
    rests on kinks                 other units
    not piecewise affine           ReLU units instead
    no matrix inequality           retrain with the certificate
    certified by a loose bound     a gain clipped less often, one that is not clipped at first, one that seldom is
    """
    best = best_certified(history)
    tasks = [_retry(one, best) for one in latest]
    return _new(history, [task for task in tasks if task is not None])


def improvements(history: Sequence[Done]) -> tuple[Task, ...]:
    """Return what lowers a bound that a matrix inequality certifies: the BMI loop, once, on the best such law.

    A law that never switches is such a law where exact pieces do not apply.
    """
    best = best_certified(history)
    if best is None or best.attempt.verdict is None or best.task.way == CERTIFIED or best.attempt.inc is None:
        return ()
    unswitched = isinstance(best.attempt.verdict.certificate, UnswitchedCost) and not cut_into_pieces(best.task.spec)
    if not unswitched and not isinstance(best.attempt.verdict.certificate, MatrixCertificate):
        return ()
    return _new(history, [_with_certificate(best, "lower the bound that the inequality certifies")])


def explorations(history: Sequence[Done], template: Task, turn: int) -> tuple[Task, ...]:
    """Return what else may cost less: other starts that suit the problem first, then more seeds and more units around the
    best law.

    turn: 1 for the first of such rounds; template: the task whose problem and seed they share.
    """
    fresh = replace(template, way=TRAINED, why="another start")
    tasks: list[Task] = []
    if turn == 1:
        tasks += [replace(fresh, start=name, way=way) for name, way in OTHER_STARTS
                  if (template.hidden or way == AS_IT_IS) and may_suit(name, template.plant, template.spec)]
    if template.hidden:
        seed = template.seed + turn
        tasks.append(replace(fresh, start="random", seed=seed, label=f"seed {seed}"))
        best = best_certified(history)
        if best is not None and best.attempt.inner is not None:
            tasks.append(_widened(best, template, seed))
    return _new(history, tasks)


def _retry(one: Done, best: Done | None) -> Task | None:
    verdict = one.attempt.verdict
    if verdict is not None and verdict.accepted and not verdict.settled:
        return _bounded_closer(one)
    cause = None if verdict is None or verdict.settled else first_of(verdict.causes)
    if cause is None:
        return None
    task = _REMEDIES[cause](one, best)
    return None if task is None else replace(task, of=one.task.name, why=cause.value)


def _bounded_closer(one: Done) -> Task | None:
    start = _FEWER_CLIPPED.get(one.task.start) if one.task.way == AS_IT_IS else None
    return None if start is None else replace(one.task, start=start, label="", of=one.task.name,
                                              why="the cost is bounded loosely where inputs are clipped")


def _tighter(one: Done, _: Done | None) -> Task | None:
    task = one.task
    kappa = TIGHTER * task.kappa
    return replace(task, kappa=kappa, label=f"kappa {kappa:.3g}") if task.way == TRAINED else None


def _smaller(one: Done, best: Done | None) -> Task | None:
    task = one.task
    if task.way == AS_IT_IS or task.law is not None or task.hidden < 2:
        return _from_certified(one, best) if task.way == AS_IT_IS else None
    half = task.hidden // 2
    return replace(task, hidden=half, kappa=TIGHTER * task.kappa, label=f"{half} units, kappa {TIGHTER * task.kappa:.3g}")


def _stabilizing(one: Done, _: Done | None) -> Task | None:
    return replace(one.task, start="stabilizing gain", law=None, label="")


def _from_certified(one: Done, best: Done | None) -> Task | None:
    task = one.task
    if task.way == AS_IT_IS:
        start = _CALMER.get(task.start)
        return None if start is None else replace(task, start=start, label="")
    longer = 2 * max(task.horizon or 0, SHORTEST)
    label = f"{longer} steps"
    if best is not None and best.attempt.inner is not None:
        law = with_room(best.attempt.inner, task)
        return replace(task, start=f"from ({best.task.name})", law=law, horizon=longer, label=label)
    return replace(task, horizon=longer, label=label)


def _within(one: Done, _: Done | None) -> Task | None:
    return None if one.task.way != TRAINED or one.task.shrunk else replace(one.task, shrunk=True, label="limits shrunk")


def _reseeded(one: Done, _: Done | None) -> Task | None:
    seed = one.task.seed + 1
    return replace(one.task, seed=seed, label=f"seed {seed}") if one.task.way == TRAINED and one.task.law is None else None


def _affine(one: Done, _: Done | None) -> Task | None:
    if one.task.law is not None or isinstance(one.task.activation, ReLU):
        return None
    return replace(one.task, activation=ReLU(), label="ReLU units")


def _certificate_aware(one: Done, _: Done | None) -> Task | None:
    return None if one.task.way == CERTIFIED else _with_certificate(one, "")


_REMEDIES: dict[Cause, Callable[[Done, Done | None], Task | None]] = {
    Cause.ILL_POSED: _tighter, Cause.UNSTABLE: _stabilizing, Cause.LOST: _from_certified, Cause.PIECES: _smaller,
    Cause.TIME: _smaller, Cause.LIMITS: _within, Cause.KINK: _reseeded, Cause.SMOOTH: _affine,
    Cause.UNCERTIFIED: _certificate_aware}


def _with_certificate(one: Done, why: str) -> Task | None:
    inc = one.attempt.inc
    if inc is None or not built_in(inc, one.task.spec):
        return None
    return replace(one.task, start=f"from ({one.task.name})", law=inc, way=CERTIFIED, label="", of=one.task.name, why=why)


def _widened(best: Done, template: Task, seed: int) -> Task:
    assert best.attempt.inner is not None
    units = min(MOST_UNITS, best.attempt.inner.q + template.hidden)
    law = with_room(best.attempt.inner, replace(template, hidden=units, seed=seed))
    root = best.task.start if best.task.start.startswith("from (") else f"from ({best.task.name})"
    return replace(template, start=root, law=law, way=TRAINED, seed=seed, label=f"{law.q} units",
                   of=best.task.name, why="more units, all that is found so far kept")


def _new(history: Sequence[Done], tasks: Sequence[Task | None]) -> tuple[Task, ...]:
    """The tasks that were not made before, each once."""
    seen = {one.task.name for one in history}
    fresh: dict[str, Task] = {task.name: task for task in tasks if task is not None and task.name not in seen}
    return tuple(fresh.values())
