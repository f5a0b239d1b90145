"""The candidates that are tried: each a start, perhaps trained, sent through the gate and through simulation."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inc_casadi import INC, Box, Plant, Spec
from inc_casadi.activations import Activation
from inc_casadi.errors import INCError
from inc_casadi.estimate import estimate
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.linear.static_gain import best_static_gain
from inc_casadi.pieces.walk import Budget

from .gate import gate
from .result import Attempt
from .starts.random_start import linear_start, random_start

QUICK_SAMPLES = 4_000


@dataclass(frozen=True, eq=False)
class Task:
    """One attempt to be made, with all that it needs: it can be sent to another process.

    start: "clipped LQR", "static gain" or "random"; trained: whether the NLP improves the start; seconds: what training
    and the regional proof may take, each.
    """

    start: str
    trained: bool
    plant: Plant
    spec: Spec
    hidden: int
    activation: Activation
    kappa: float
    seed: int
    seconds: float

    @property
    def name(self) -> str:
        """The task in words."""
        return f"{self.start}, trained" if self.trained else self.start


def plan(plant: Plant, spec: Spec, hidden: int, activation: Activation, kappa: float, seed: int,
         seconds: float) -> tuple[Task, ...]:
    """Return the tasks for a problem: LQR needs the full state and a box or no limits, other problems a static gain."""
    simple = isinstance(spec.inputs, Box) or spec.inputs is None
    informed = "clipped LQR" if plant.full_state and simple else "static gain"
    task = Task(informed, False, plant, spec, hidden, activation, kappa, seed, seconds)
    tasks = [task]
    if hidden:
        tasks += [replace(task, trained=True), replace(task, start="random", trained=True)]
    return tuple(tasks)


def attempt(task: Task) -> Attempt:
    """Make one candidate, send it through the gate and simulate it; what goes wrong is the attempt's note."""
    clock = time.monotonic()
    try:
        inc, note, training = _candidate(task)
    except INCError as error:
        return Attempt(task.name, None, None, None, time.monotonic() - clock, str(error))
    verdict = gate(task.plant, task.spec, inc, Budget(seconds=task.seconds))
    run = estimate(task.plant, inc, task.spec, samples=QUICK_SAMPLES, seed=task.seed)
    return Attempt(task.name, inc, verdict, run, time.monotonic() - clock, note, training)


def _candidate(task: Task) -> tuple[INC, str, tuple[tuple[float, float], ...]]:
    inner = _start(task)
    if not task.trained:
        return limited(inner.without_idle_units(), task.spec), "", ()
    from .training import train
    run = train(task.plant, task.spec, inner, kappa=task.kappa, time_limit=task.seconds)
    return run.inc, run.status, tuple((row["seconds"], row["cost"]) for row in run.history)


def _start(task: Task) -> INC:
    plant, spec = task.plant, task.spec
    if task.start == "random":
        return random_start(plant, spec, task.hidden, task.activation, task.kappa, task.seed)
    if task.start == "clipped LQR":
        gain = np.linalg.solve(plant.C.T, lqr_gain(plant, spec).T).T
    else:
        gain = best_static_gain(plant, spec, seed=task.seed).F
    return linear_start(gain, plant, spec, task.hidden, task.activation, task.kappa, task.seed)


def lqr_gain(plant: Plant, spec: Spec) -> Any:
    """Return the discounted LQR gain K (m, n), u = K x; the undiscounted one when the former does not stabilize."""
    K, _ = discounted_lqr(plant, spec)
    if np.max(np.abs(np.linalg.eigvals(plant.A + plant.B @ K))) >= 1:
        K, _ = discounted_lqr(plant, replace(spec, discount=1.0))
    return K


def limited(inner: INC, spec: Spec) -> INC:
    """Return the law with the input limits built in, where they are a box."""
    return inner.with_saturated_output(spec.inputs) if isinstance(spec.inputs, Box) else inner
