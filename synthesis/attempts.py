"""One attempt: a start, perhaps trained or retrained with the certificate, sent through the gate and through simulation."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from inc_casadi import INC, Box, Plant, Spec
from inc_casadi.activations import Activation
from inc_casadi.errors import INCError, InvalidInputError
from inc_casadi.estimate import estimate
from inc_casadi.judgement.clipped import MOST_FOLLOWED
from inc_casadi.pieces.walk import Budget
from inc_casadi.sets import Polytope, Uniform

from .causes import Cause
from .gate import gate
from .one_thread import one_thread
from .readout import inner_of, limited, wider
from .registry import STARTS
from .result import Attempt
from .starts.random_start import random_start
from .starts.resting import resting

QUICK_SAMPLES, LATE_SAMPLES = 4_000, 400  # the latter where the time is over
PIECES = 50_000
TRAINING = 0.6  # of the time that is left, at most; the proof needs some
SHRUNK = 0.98  # of the input limits, where a law that was trained on all of them went beyond

AS_IT_IS, TRAINED, CERTIFIED = "as it is", "trained", "retrained with its certificate"
WAYS = (AS_IT_IS, TRAINED, CERTIFIED)

_one_ipopt = threading.Lock()  # MUMPS is not thread-safe: threads of one process train one after another


@dataclass(frozen=True, eq=False)
class Task:
    """One attempt to be made, with all that it needs: it can be sent to another process.

    start: a name in `STARTS`, or of the law that is given; law: begin with this one instead; way: of WAYS; label: what
    else tells it apart; of, why: the attempt that it follows from, and for what reason; hidden, activation, kappa, seed:
    of the units; horizon: of training, by default its own choice; iterations: of training, or rounds of the BMI loop;
    shrunk: train on 0.98 of the input limits; biased: whether trained units have biases, which a matrix inequality about
    every initial state hardly bears; frozen: names of matrices that training leaves alone; form: of the training program,
    options: others of it;
    seconds: what training and proof may take, each; until: the time.time() when all must end.
    """

    start: str
    way: str
    plant: Plant
    spec: Spec
    hidden: int
    activation: Activation
    kappa: float
    seed: int
    seconds: float
    iterations: int = 60
    law: INC | None = None
    label: str = ""
    of: str = ""
    why: str = ""
    horizon: int | None = None
    shrunk: bool = False
    biased: bool = True
    frozen: tuple[str, ...] = ()
    form: str = "auto"
    options: Mapping[str, Any] = field(default_factory=dict)
    until: float = math.inf

    @property
    def name(self) -> str:
        """The task in words."""
        return ", ".join(part for part in (self.start, "" if self.way == AS_IT_IS else self.way, self.label) if part)

    def left(self, share: float = 1.0) -> float:
        """Seconds that its next part may take: a share of what is left of the budget at most."""
        return max(0.0, min(self.seconds, share * (self.until - time.time())))


def plan(plant: Plant, spec: Spec, hidden: int, activation: Activation, kappa: float, seed: int, seconds: float,
         iterations: int = 60, starts: Sequence[str] | None = None, given: Sequence[INC] = (),
         frozen: Sequence[str] = (), form: str = "auto",
         options: Mapping[str, Any] | None = None) -> tuple[Task, ...]:
    """Return the first round: the laws given, and the starts that suit the problem, as they are and trained.

    LQR needs the full state and a box or no limits, other problems a static gain. Where the cost of clipped laws is hardly
    worked out, a gain that is seldom clipped comes first: it takes little time, and its cost is nearly known. starts: these
    instead.
    """
    task = Task("", AS_IT_IS, plant, spec, hidden, activation, kappa, seed, seconds, iterations, frozen=tuple(frozen),
                form=form, options=dict(options or {}), biased=cut_into_pieces(spec) or not rests_at_zero(spec))
    ways = (AS_IT_IS, TRAINED) if hidden else (AS_IT_IS,)
    laws = [{AS_IT_IS: law, TRAINED: with_room(inner_of(law, spec), task)} for law in given]
    tasks = [replace(task, start=f"given {i + 1}", way=way, law=law[way]) for i, law in enumerate(laws) for way in ways]
    if starts is not None:
        return (*tasks, *(replace(task, start=name, way=way) for name in starts for way in ways
                          if (name, way) != ("random", AS_IT_IS)))
    simple = isinstance(spec.inputs, Box) or spec.inputs is None
    informed = ["clipped LQR"] if plant.full_state and simple else ["static gain"]
    clipped = ["clipped gain"] if informed == ["static gain"] and isinstance(spec.inputs, Box) else []
    known = ["seldom clipped gain"] if plant.n > MOST_FOLLOWED else []
    tasks += [replace(task, start=name) for name in known + informed + clipped]
    if hidden:
        tasks += [replace(task, start=name, way=TRAINED) for name in (*informed, "random")]
    return tuple(tasks)


def cut_into_pieces(spec: Spec) -> bool:
    """Whether the exact proof, which takes biases as they are, applies to the initial distribution."""
    return isinstance(spec.initial, Uniform) and isinstance(spec.initial.support, Box | Polytope)


def rests_at_zero(spec: Spec) -> bool:
    """Whether u = 0 keeps the input limits."""
    return spec.inputs is None or bool(spec.inputs.contains(np.zeros(spec.m)))


def with_room(inner: INC, task: Task) -> INC:
    """Return the law with idle random units beside its own until there are task.hidden of them."""
    missing = max(0, task.hidden - inner.q)
    return wider(inner, random_start(task.plant, task.spec, missing, task.activation, task.kappa, task.seed))


def attempt(task: Task) -> Attempt:
    """Make one candidate, send it through the gate and simulate it; what goes wrong is the attempt's note."""
    with one_thread():
        return _attempt(task)


def _attempt(task: Task) -> Attempt:
    clock = time.monotonic()
    try:
        made = _made(task)
    except INCError as error:
        return Attempt(task.name, None, None, None, time.monotonic() - clock, str(error), of=task.of, why=task.why)
    verdict = gate(task.plant, task.spec, made.inc, Budget(pieces=PIECES, seconds=task.left()))
    samples = LATE_SAMPLES if task.until <= time.time() else QUICK_SAMPLES
    run = estimate(task.plant, made.inc, task.spec, samples=samples, seed=task.seed)
    timed = "time limit" in made.note or Cause.TIME in verdict.causes or (
        task.iterations > 0 and "nothing searched" in made.note)
    return Attempt(task.name, made.inc, verdict, run, time.monotonic() - clock, made.note, made.training, made.inner,
                   task.of, task.why, made.before, timed)


@dataclass(frozen=True, eq=False)
class _Made:
    """A candidate, the law without its limits, and how it was made; before: the certified bound it began with."""

    inc: INC
    inner: INC
    note: str = ""
    training: tuple[tuple[float, float], ...] = ()
    before: float = math.nan


def _made(task: Task) -> _Made:
    law = task.law
    if law is None:
        law = STARTS[task.start](task.plant, task.spec, task.hidden, task.activation, task.kappa, task.seed)
    if task.way == AS_IT_IS:
        law = law.without_idle_units()
        return _Made(limited(law, task.spec), inner_of(law, task.spec))
    with _one_ipopt:
        return _retrained(task, law) if task.way == CERTIFIED else _trained(task, inner_of(law, task.spec))


def _trained(task: Task, inner: INC) -> _Made:
    from .training import train

    if not task.biased:
        inner = INC(inner.W, inner.U, inner.V, inner.K, activation=inner.activations)
    frozen = task.frozen if task.biased else (*task.frozen, "b", "d")
    options = {**task.options, **({} if task.horizon is None else {"horizon": task.horizon})}
    run = train(task.plant, _training_spec(task), inner, kappa=task.kappa, frozen=frozen, max_iterations=task.iterations,
                time_limit=task.left(TRAINING), form=task.form, seed=task.seed, **options)
    return _Made(_at_rest(run.inc, task), run.inner, run.status, tuple((row["seconds"], row["cost"]) for row in run.history))


def _at_rest(law: INC, task: Task) -> INC:
    """Return the law at rest at the origin in exact arithmetic: without discount the least offset costs without end."""
    if not task.biased or task.spec.discount < 1 or not rests_at_zero(task.spec):
        return law
    try:
        return resting(law)
    except InvalidInputError:  # other units than ReLU and Saturation
        return law


def _retrained(task: Task, law: INC) -> _Made:
    from .retraining import with_certificate

    run = with_certificate(task.plant, task.spec, limited(law, task.spec), task.kappa, task.iterations, task.left(TRAINING),
                           task.seed, task.frozen)
    return _Made(run.inc, inner_of(run.inc, task.spec), run.note, run.history, run.before)


def _training_spec(task: Task) -> Spec:
    """Return the specification to train on: that of the problem, or with limits shrunk about their middle."""
    inputs = task.spec.inputs
    if not task.shrunk or inputs is None:
        return task.spec
    if isinstance(inputs, Box):
        middle, half = (inputs.lower + inputs.upper) / 2, SHRUNK * (inputs.upper - inputs.lower) / 2
        return replace(task.spec, inputs=Box(middle - half, middle + half))
    from .input_box import inscribed_box

    box = inscribed_box(inputs)
    middle = (box.lower + box.upper) / 2
    return replace(task.spec, inputs=Polytope(inputs.H, inputs.H @ middle + SHRUNK * (inputs.h - inputs.H @ middle)))
