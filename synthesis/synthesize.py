"""The main verb: from a plant and a specification to a proved controller."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

import numpy as np

from inc_casadi import INC, Plant, ReLU, Spec, bounds
from inc_casadi.activations import Activation
from inc_casadi.arrays import number
from inc_casadi.bounds import Bound
from inc_casadi.certificate import Certificate, Proof
from inc_casadi.errors import DimensionError, INCError, InfeasibleError, InvalidInputError, NotStabilizableError
from inc_casadi.estimate import Estimate, estimate
from inc_casadi.figures import at_least
from inc_casadi.plant import as_plant
from inc_casadi.sets.rules import whole

from .attempts import plan
from .competitors import linear_competitors
from .followups import Done, best_certified
from .no_gain import no_stabilizing_gain
from .phases import FORMS
from .progress import Progress, counted
from .registry import STARTS
from .result import Attempt, Result
from .rounds import Goal, search

CELLS = 3_000
ANY = "any controller"
MATRICES = ("W", "U", "V", "K", "b", "d")


def synthesize(plant: Any, spec: Spec, *, hidden: int = 8, activation: Activation | None = None, kappa: float = 0.95,
               seed: int = 0, executor: Executor | None = None, verbose: bool = True, training_seconds: float = 10.0,
               training_iterations: int = 60, seconds: float | None = None, rounds: int | None = None, tol: float = 1e-3,
               start: INC | Sequence[INC] = (), starts: Sequence[str] | None = None,
               frozen: Sequence[str] = (), form: str = "shooting") -> Result:
    """Return a static controller for the plant with proof, or with an honest word on why there is none.

    Algorithm 1 of the paper. Candidates start from the clipped discounted LQR (or static output gains) and from random
    weights, an NLP improves them under ||W||_inf <= kappa, and only what passes the gate is called certified. A refusal is
    followed by a retry that its reason suggests (`followups.repairs`), a bound by matrix inequality is lowered by the BMI
    loop. Of the certified candidates the one with the lowest certified cost is returned; without any, the one that
    simulates best. Lower bounds for linear and for all controllers are computed first, and the search ends when the
    certified cost is within tol of the latter.

    Parameters
    ----------
    plant : a discrete-time Plant or control.StateSpace
    spec : the cost, initial distribution and input limits
    hidden : hidden units of the trained law, 0 for none
    activation : of those units, ReLU when left out
    kappa : in (0, 1), the well-posedness budget
    seed : of all random choices
    executor : any concurrent.futures.Executor that takes picklable tasks computes the attempts of a round at the same time.
        Threads train one after another, for IPOPT's linear solver is not safe among threads; processes, and a Dask
        cluster by client.get_executor(), do not wait
    verbose : a line for each thing that is tried, with best certified cost, lower bound, gap and time left
    training_seconds : what one training and one proof may take
    training_iterations : of IPOPT on the coarse nodes, and rounds of one BMI loop
    seconds : budget for the search, counted from the call; the first start is always judged, and the last proof comes on
        top. With it or with `rounds` the search goes on where nothing was refused: other starts (MPC, laws compressed from
        it, certified feedback, more seeds), more units
    rounds : the most rounds of attempts. Without both, one, and up to two rounds of retries of what was refused
    tol : nothing more is tried within this share of the lower bound; 0 for never
    start : a law to begin with besides, or several: a former result's `inc`, say
    starts : names in `registry.STARTS` that are tried instead of those that suit the problem
    frozen : names among W, U, V, K, b, d that training leaves as the start has them: ("W", "K") with starts=["random"] gives
        a network with feedback among its units and no linear path beside it
    form : of the training program, as `train` has it: "shooting", "lifted" (up to about 8 units), or "projected", the
        paper's projected gradient, which is quick per step and takes many units

    Notes
    -----
    The same call gives the same answer with any executor: attempts end by iteration and piece limits and run with one thread
    of linear algebra, rounds wait for all of theirs, and they are looked at in a fixed order. Only where a time limit cuts
    one short (`Attempt.timed`, said in `notes`) can the machine matter. Interrupting it (Ctrl-C) returns the best of the
    attempts that were finished.

    Raises
    ------
    DimensionError, InvalidInputError : arguments that do not fit
    NotStabilizableError : an unstable mode is out of the input's reach
    InfeasibleError : the limits are too small for the initial set

    Examples
    --------
    >>> from inc_casadi import Box
    >>> spec = Spec([[1.0]], [[0.0]], 0.9, initial=Box([-1.0], [1.0]), inputs=Box([-1.0], [1.0]))
    >>> result = synthesize(Plant([[1.5]], [[1.0]]), spec, hidden=0, verbose=False)
    >>> result.status, round(result.cost, 6), round(1 / 3 + 0.9 / 36, 6)
    ('certified', 0.358333, 0.358333)
    """
    progress, began = Progress(verbose, np.inf if seconds is None else number("seconds", seconds, 0.0)), time.time()
    plant = as_plant(plant)
    activation = ReLU() if activation is None else activation
    _check(plant, spec, hidden, activation, kappa)
    given, names = _given(plant, start), _named("starts", starts, STARTS)
    if names == () and not given:
        raise InvalidInputError("starts is empty and no start is given, so there is nothing to try")
    left_alone = _named("frozen", frozen, MATRICES) or ()
    if form not in FORMS:
        raise InvalidInputError(f"form is {form!r}, but must be one of {', '.join(FORMS)}")
    tol, iterations = number("tol", tol, 0.0), whole("training_iterations", training_iterations, 0)
    rounds = None if rounds is None else whole("rounds", rounds, 1)
    took: dict[str, float] = {}
    notes: list[str] = []
    with _phase(took, "bounds"):
        lower = _lower_bounds(plant, spec, notes, progress)
        linear = linear_competitors(plant, spec, seed, notes, progress.say)
        obstruction = no_stabilizing_gain(plant) if spec.inputs is not None else ""
    if obstruction:
        notes.append(obstruction + "; laws with a kink there are not tried")
        progress.say(notes[-1])
    with _phase(took, "search and proof"):
        tasks = plan(plant, spec, 0 if obstruction else hidden, activation, kappa, seed, training_seconds, iterations,
                     names, given, left_alone, form)
        goal = Goal(_floor(lower), tol, 1 if obstruction else rounds, began + progress.seconds)
        found = search(tasks, goal, executor, progress)
    best = _best(found.history)
    with _phase(took, "simulation"):
        run = _simulated(plant, spec, best, seed)
    certificate = best.verdict.certificate if best and best.verdict else None
    with _phase(took, "rigorous proof"):
        proof = _settled(certificate, notes, progress)
    took["in all"] = progress.elapsed
    history = tuple(one.attempt for one in found.history)
    notes += _remarks(history, best, found.ended)
    ended = f"{counted(len(history), 'attempt')} in {counted(found.rounds, 'round')}; " + (
        "no other static law is worth trying" if obstruction else found.ended)
    return Result(plant, spec, best.inc if best else None, certificate, proof, run, lower, linear, history, tuple(notes),
                  took, best, ended)


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


def _given(plant: Plant, start: INC | Sequence[INC]) -> tuple[INC, ...]:
    laws = (start,) if isinstance(start, INC) else tuple(start)
    for law in laws:
        if not isinstance(law, INC):
            raise InvalidInputError(f"start must be an INC or several, not {type(law).__name__}")
        if (law.p, law.m) != (plant.p, plant.m):
            raise DimensionError(f"start maps {law.p} measurements to {law.m} inputs, but the plant has {plant.p} "
                                 f"measurements and {plant.m} inputs")
    return laws


def _named(keyword: str, names: Sequence[str] | None, known: Collection[str]) -> tuple[str, ...] | None:
    if names is None:
        return None
    if isinstance(names, str) or any(name not in known for name in names):
        raise InvalidInputError(f"{keyword} = {names!r} must list names among {', '.join(known)}")
    return tuple(names)


def _lower_bounds(plant: Plant, spec: Spec, notes: list[str], progress: Progress) -> dict[str, Bound]:
    computed: dict[str, Bound] = {}
    for name, compute in (("linear controllers, first move", lambda: bounds.first_move(plant, spec)),
                          ("linear controllers", lambda: bounds.affine_moves(plant, spec)),
                          (ANY, lambda: bounds.any_controller(plant, spec, cells=CELLS))):
        try:
            computed[name] = compute()
        except INCError as error:
            notes.append(f"no lower bound for {name}: {error}")
            continue
        progress.say(f"lower bound, {name}: {at_least(float(computed[name]))}")
    return computed


def _floor(lower: dict[str, Bound]) -> float:
    """The proved lower bound on every controller, -inf without."""
    bound = lower.get(ANY)
    return float(bound) if bound is not None and bound.holds() else -np.inf


def _best(history: Sequence[Done]) -> Attempt | None:
    """The certified attempt with the lowest certified cost, else the one that simulates best within the limits."""
    certified = best_certified(history)
    if certified is not None:
        return certified.attempt
    return min((one.attempt for one in history if one.attempt.estimate is not None), key=_ordeal, default=None)


def _remarks(history: Sequence[Attempt], best: Attempt | None, ended: str) -> list[str]:
    """What a reader must know besides: interruptions, time limits, and all reasons where nothing is certified."""
    notes = [ended] if ended.startswith(("interrupted", "the executor")) else []
    if best is None or not best.certified:
        notes += [f"{one.name}: {reason}" for one in history if one is not best
                  for reason in ([one.note] if one.verdict is None else one.verdict.refusals)]
    timed = [one.name for one in history if one.timed]
    if timed:
        notes.append(f"cut short by a time limit, so that another machine may find another answer: {'; '.join(timed)}")
    return notes


def _simulated(plant: Plant, spec: Spec, best: Attempt | None, seed: int) -> Estimate | None:
    """Simulate from more points than the attempt did, unless its motions do not come to rest anyway."""
    if best is None or best.inc is None or best.estimate is None or not best.estimate.settled:
        return None if best is None else best.estimate
    return estimate(plant, best.inc, spec, seed=seed)


def _settled(certificate: Certificate | None, notes: list[str], progress: Progress) -> Proof | None:
    if certificate is None:
        return None
    progress.say("settling the proof rigorously")
    try:
        proof = certificate.prove()
    except KeyboardInterrupt:
        notes.append("interrupted while the proof was settled rigorously: it holds in floating point")
        return None
    progress.say(f"proved rigorously: {proof.method}" if proof else f"not settled rigorously: {proof.reason}")
    return proof


def _ordeal(one: Attempt) -> tuple[bool, bool, float]:
    """What simulation has against an attempt: no rest, a limit exceeded, the cost."""
    assert one.estimate is not None
    return not one.estimate.settled, one.estimate.excess > 1e-9, one.estimate.mean


@contextmanager
def _phase(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Put the wall time of a block into a table."""
    start = time.monotonic()
    yield
    seconds[name] = time.monotonic() - start
