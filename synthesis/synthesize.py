"""The main verb: from a plant and a specification to a proved controller."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, as_completed
from contextlib import contextmanager
from typing import Any

import numpy as np

from inc_casadi import Plant, ReLU, Spec, bounds
from inc_casadi.activations import Activation
from inc_casadi.arrays import number
from inc_casadi.bounds import Bound
from inc_casadi.certificate import Certificate, Proof
from inc_casadi.errors import INCError, InfeasibleError, InvalidInputError, NotStabilizableError
from inc_casadi.estimate import estimate
from inc_casadi.figures import at_least, at_most
from inc_casadi.plant import as_plant

from .attempts import Task, attempt, plan
from .competitors import linear_competitors
from .result import Attempt, Result

CELLS = 3_000

Say = Callable[[str], None]


def synthesize(plant: Any, spec: Spec, *, hidden: int = 8, activation: Activation | None = None, kappa: float = 0.95,
               seed: int = 0, executor: Executor | None = None, verbose: bool = True,
               training_seconds: float = 10.0) -> Result:
    """Return a static controller for the plant with proof, or with an honest word on why there is none.

    Algorithm 1 of the paper: candidates start from the clipped discounted LQR (or a static output gain) and from
    random weights, an NLP improves them under ||W||_inf <= kappa, and only what passes the gate is called certified.
    Of the certified candidates the one with the lowest certified cost is returned; without any, the one that
    simulates best. Lower bounds for linear and for all controllers are computed beside it.

    plant: a discrete-time Plant or control.StateSpace; spec: the cost, initial distribution and input limits; hidden:
    hidden units of the trained law, 0 for none; activation: of those units, ReLU when left out; kappa: in (0, 1), the
    well-posedness budget; seed: of all random choices, so the same call gives the same answer; executor: runs the
    attempts in parallel when given (any concurrent.futures.Executor that takes picklable tasks); verbose: a line
    per phase; training_seconds: what one training and one proof may take.

    Interrupting it (Ctrl-C) returns the best of the attempts that were finished.

    Raises DimensionError and InvalidInputError for arguments that do not fit, NotStabilizableError when an unstable mode
    is out of the input's reach, InfeasibleError when the limits are too small for the initial set.

    >>> from inc_casadi import Box
    >>> spec = Spec([[1.0]], [[0.0]], 0.9, initial=Box([-1.0], [1.0]), inputs=Box([-1.0], [1.0]))
    >>> result = synthesize(Plant([[1.5]], [[1.0]]), spec, hidden=0, verbose=False)
    >>> result.status, round(result.cost, 6), round(1 / 3 + 0.9 / 36, 6)
    ('certified', 0.358333, 0.358333)
    """
    clock = time.monotonic()
    say = _speaker(verbose, clock)
    plant = as_plant(plant)
    activation = ReLU() if activation is None else activation
    _check(plant, spec, hidden, activation, kappa)
    seconds: dict[str, float] = {}
    notes: list[str] = []
    with _phase(seconds, "bounds"):
        lower = _lower_bounds(plant, spec, notes, say)
        linear = linear_competitors(plant, spec, seed, notes, say)
    with _phase(seconds, "search and proof"):
        tasks = plan(plant, spec, hidden, activation, kappa, seed, training_seconds)
        history = _run(tasks, executor, notes, say)
    best = _best(history)
    with _phase(seconds, "simulation"):
        run = estimate(plant, best.inc, spec, seed=seed) if best and best.inc else None
    certificate = best.verdict.certificate if best and best.verdict else None
    with _phase(seconds, "rigorous proof"):
        proof = _settled(certificate, notes, say)
    seconds["in all"] = time.monotonic() - clock
    if best is None or not best.certified:
        notes += [f"{one.name}: {reason}" for one in history if one is not best
                  for reason in ([one.note] if one.verdict is None else one.verdict.refusals)]
    return Result(plant, spec, best.inc if best else None, certificate, proof, run, lower, linear, tuple(history),
                  tuple(notes), seconds, best)


def _check(plant: Plant, spec: Spec, hidden: int, activation: Activation, kappa: float) -> None:
    if not isinstance(spec, Spec):
        raise InvalidInputError(f"spec must be a Spec, not {type(spec).__name__}")
    if not isinstance(activation, Activation):
        raise InvalidInputError(f"activation must be an Activation such as ReLU(), not {activation!r}")
    number("kappa", kappa, 0.0, 1.0, open_low=True, open_high=True)
    if not isinstance(hidden, int | np.integer) or isinstance(hidden, bool) or hidden < 0:
        raise InvalidInputError(f"hidden = {hidden!r} must be a whole number of hidden units, 0 or more")
    if not plant.discrete:
        raise InvalidInputError("synthesize works in discrete time and this plant is continuous: give it plant.sampled(dt), "
                                "or Plant.from_control(sys).sampled(dt), with Q and R per step")
    spec.check(plant)
    modes = plant.unstabilizable_modes()
    if modes:
        words = ", ".join(f"{mode:.6g}" for mode in modes)
        raise NotStabilizableError(f"the plant is not stabilizable: no input reaches the mode with eigenvalue {words}")
    obstruction = bounds.uncontrollable_vertex(plant, spec)
    if obstruction:
        raise InfeasibleError(obstruction)


def _lower_bounds(plant: Plant, spec: Spec, notes: list[str], say: Say) -> dict[str, Bound]:
    computed: dict[str, Bound] = {}
    for name, compute in (("linear controllers, first move", lambda: bounds.first_move(plant, spec)),
                          ("linear controllers", lambda: bounds.affine_moves(plant, spec)),
                          ("any controller", lambda: bounds.any_controller(plant, spec, cells=CELLS))):
        try:
            computed[name] = compute()
        except INCError as error:
            notes.append(f"no lower bound for {name}: {error}")
            continue
        say(f"lower bound, {name}: {at_least(float(computed[name]))}")
    return computed


def _run(tasks: tuple[Task, ...], executor: Executor | None, notes: list[str], say: Say) -> list[Attempt]:
    done: list[Attempt] = []
    try:
        for one in _attempts(tasks, executor):
            done.append(one)
            say(_line(one))
    except KeyboardInterrupt:
        notes.append(f"interrupted after {len(done)} of {len(tasks)} attempts: this is the best of those")
    order = {task.name: i for i, task in enumerate(tasks)}
    return sorted(done, key=lambda one: order[one.name])


def _attempts(tasks: tuple[Task, ...], executor: Executor | None) -> Iterator[Attempt]:
    if executor is None:
        yield from map(attempt, tasks)
        return
    futures = [executor.submit(attempt, task) for task in tasks]
    for future in as_completed(futures):
        yield future.result()


def _line(one: Attempt) -> str:
    if one.verdict is None or one.estimate is None:
        return f"{one.name}: no candidate, {one.note}"
    if one.certified:
        return f"{one.name}: certified cost at most {at_most(one.verdict.cost)}"
    return f"{one.name}: not certified, simulated cost {one.estimate.mean:.4f}"


def _best(history: list[Attempt]) -> Attempt | None:
    """The certified attempt with the lowest certified cost, else the one that simulates best within the limits."""
    certified = [one for one in history if one.certified]
    if certified:
        return min(certified, key=lambda one: one.verdict.cost)  # type: ignore[union-attr]
    return min((one for one in history if one.estimate is not None), key=_ordeal, default=None)


def _settled(certificate: Certificate | None, notes: list[str], say: Say) -> Proof | None:
    if certificate is None:
        return None
    say("settling the proof rigorously")
    try:
        proof = certificate.prove()
    except KeyboardInterrupt:
        notes.append("interrupted while the proof was settled rigorously: it holds in floating point")
        return None
    say(f"proved rigorously: {proof.method}" if proof else f"not settled rigorously: {proof.reason}")
    return proof


def _ordeal(one: Attempt) -> tuple[bool, bool, float]:
    """What simulation has against an attempt: no rest, a limit exceeded, the cost."""
    assert one.estimate is not None
    return not one.estimate.settled, one.estimate.excess > 1e-9, one.estimate.mean


def _speaker(verbose: bool, clock: float) -> Say:
    def say(line: str) -> None:
        if verbose:
            print(f"[{time.monotonic() - clock:5.1f} s] {line}", flush=True)
    return say


@contextmanager
def _phase(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Put the wall time of a block into a table."""
    start = time.monotonic()
    yield
    seconds[name] = time.monotonic() - start
