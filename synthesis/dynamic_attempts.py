"""One attempt at a controller with memory: a start, perhaps trained, sent through the gate and through simulation."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import final

from inc_casadi import Plant, Spec
from inc_casadi.activations import Activation
from inc_casadi.brief import Brief
from inc_casadi.dynamic import DynamicINC
from inc_casadi.errors import INCError
from inc_casadi.pieces.walk import Budget

from .attempts import LATE_SAMPLES, PIECES, QUICK_SAMPLES, TRAINING, _one_ipopt
from .causes import Cause
from .dynamic_gate import gate_dynamic
from .dynamic_result import DynamicAttempt
from .dynamic_starts import DYNAMIC_STARTS
from .dynamic_training import simulated_dynamic, train_dynamic, with_units
from .one_thread import one_thread

PROOF = 0.4  # of the time that is left, at most, so that a start with too many pieces leaves some for others


@final
@dataclass(frozen=True, eq=False)
class DynamicTask(Brief):
    """One attempt to be made, with all that it needs: it can be sent to another process.

    name: of the attempt, and in `DYNAMIC_STARTS` where no controller is given; dynamic: begin with this one; trained:
    whether an NLP improves it; hidden, activation, kappa, seed: of units added for training; iterations: of training;
    seconds: what training and proof may take, each; until: the time.time() when all must end; loose: whether bounds from
    ellipsoids will do; of: the attempt that it follows from.
    """

    name: str
    plant: Plant
    spec: Spec
    seconds: float
    seed: int = 0
    dynamic: DynamicINC | None = None
    trained: bool = False
    hidden: int = 0
    activation: Activation | None = None
    kappa: float = 0.95
    iterations: int = 60
    loose: bool = False
    of: str = ""
    until: float = math.inf

    def left(self, share: float = 1.0) -> float:
        """Seconds that its next part may take: a share of what is left of the budget at most."""
        return max(0.0, min(self.seconds, share * (self.until - time.time())))


def attempt_dynamic(task: DynamicTask) -> DynamicAttempt:
    """Make one candidate, send it through the gate and simulate it; what goes wrong is the attempt's note."""
    with one_thread():
        return _attempt(task)


def _attempt(task: DynamicTask) -> DynamicAttempt:
    clock = time.monotonic()
    try:
        dynamic, note, history = _made(task)
    except INCError as error:
        return DynamicAttempt(task.name, None, None, None, time.monotonic() - clock, str(error), of=task.of)
    verdict = gate_dynamic(task.plant, task.spec, dynamic, Budget(pieces=PIECES, seconds=task.left(PROOF)), loose=task.loose)
    samples = LATE_SAMPLES if task.until <= time.time() else QUICK_SAMPLES
    run = simulated_dynamic(task.plant, task.spec, dynamic, samples, task.seed)
    timed = "time limit" in note or Cause.TIME in verdict.causes
    return DynamicAttempt(task.name, dynamic, verdict, run, time.monotonic() - clock, note, history, task.of, timed)


def _made(task: DynamicTask) -> tuple[DynamicINC, str, tuple[tuple[float, float], ...]]:
    start = DYNAMIC_STARTS[task.name](task.plant, task.spec) if task.dynamic is None else task.dynamic
    if not task.trained:
        return start, "", ()
    if task.hidden:
        start = with_units(task.plant, task.spec, start, task.hidden, task.activation, task.kappa, task.seed)
    with _one_ipopt:
        run = train_dynamic(task.plant, task.spec, start, seed=task.seed, kappa=task.kappa, max_iterations=task.iterations,
                            time_limit=task.left(TRAINING))
    history = tuple((row["seconds"], row["cost"]) for row in run.training.history)
    return run.dynamic, run.training.status, history
