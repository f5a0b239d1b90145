"""The main verb: from a plant and a specification to a proved controller."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np

from inc_casadi import INC, Plant, ReLU, Spec
from inc_casadi.activations import Activation
from inc_casadi.arrays import number
from inc_casadi.errors import InvalidInputError
from inc_casadi.estimate import Estimate, estimate
from inc_casadi.sets.rules import whole

from .attempts import plan
from .closing import ordeal, phase, remarks, settled
from .door import check, given_laws, names_in, problem
from .door import training_options as checked_options
from .followups import Done, best_certified
from .lower_bounds import competitors, floor, lower_bounds
from .no_gain import no_stabilizing_gain, with_memory
from .phases import FORMS
from .progress import Progress, counted
from .registry import STARTS
from .result import Attempt, Result
from .rounds import Goal, search

MATRICES = ("W", "U", "V", "K", "b", "d")


def synthesize(plant: Any, spec: Spec, *, hidden: int = 8, activation: Activation | None = None, kappa: float = 0.95,
               seed: int = 0, executor: Executor | None = None, verbose: bool = True, training_seconds: float = 10.0,
               training_iterations: int = 60, seconds: float | None = None, rounds: int | None = None, tol: float = 1e-3,
               start: INC | Sequence[INC] = (), starts: Sequence[str] | None = None,
               frozen: Sequence[str] = (), form: str = "auto", training_options: Mapping[str, Any] | None = None,
               period: float | None = None, proof_seconds: float | None = None) -> Result:
    """Return a static controller for the plant with proof, or with an honest word on why there is none.

    Algorithm 1 of the paper. Candidates start from the clipped discounted LQR (or static output gains) and from random
    weights, an NLP improves them under ||W||_inf <= kappa, and only what passes the gate is called certified. A refusal is
    followed by a retry that its reason suggests (`followups.repairs`), a bound by matrix inequality is lowered by the BMI
    loop. Of the certified candidates the one with the lowest certified cost is returned; without any, the one that
    simulates best. Lower bounds for linear and for all controllers are computed first, and the search ends when the
    certified cost is within tol of the latter.

    Parameters
    ----------
    plant : Plant or control.StateSpace, in discrete time, or in continuous time with `period`
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
    proof_seconds : what the rigorous proof at the end may take where pieces are settled, without limit when left out; one
        that runs out of time is none, and the result then holds in floating point only
    training_iterations : of IPOPT on the coarse nodes, and rounds of one BMI loop
    seconds : budget for bounds and search, counted from the call: bounds take up to 0.45 of it and then stand as they are.
        The first start is always judged, and the last proof comes on top. With it or with `rounds` the search goes on where
        nothing was refused: other starts (MPC, laws compressed from it, certified feedback, more seeds), more units
    rounds : the most rounds of attempts. Without both, one, and up to two rounds of retries of what was refused
    tol : nothing more is tried within this share of the lower bound; 0 for never
    start : a law to begin with besides, or several: a former result's `inc`, say
    starts : names in `registry.STARTS` that are tried instead of those that suit the problem
    frozen : names among W, U, V, K, b, d that training leaves as the start has them: ("W", "K") with starts=["random"] gives
        a network with feedback among its units and no linear path beside it
    form : of the training program, as `train` has it: "shooting", "lifted" (up to about 8 units), "projected", the paper's
        projected gradient, which is quick per step and takes many units, or "auto"
    training_options : further options of `train` by name: hessian, method, steps, readout, states, terminal, order, ...;
        states is evidence, for no proof here speaks of it
    period : seconds between samples of a continuous plant, whose input is held in between; Q, R and discount of the spec
        are then per second. `plant` and `spec` of the result are the sampled ones, as is every cost

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
    posed = problem(plant, spec, period)
    plant, spec, notes = posed.plant, posed.spec, [posed.note] if posed.note else []
    activation = ReLU() if activation is None else activation
    check(plant, spec, hidden, activation, kappa)
    given, names = given_laws(plant, start), names_in("starts", starts, STARTS)
    if names == () and not given:
        raise InvalidInputError("starts is empty and no start is given, so there is nothing to try")
    left_alone = names_in("frozen", frozen, MATRICES) or ()
    if form not in FORMS:
        raise InvalidInputError(f"form is {form!r}, but must be one of {', '.join(FORMS)}")
    options = checked_options(plant, spec, form, training_options)
    tol, iterations = number("tol", tol, 0.0), whole("training_iterations", training_iterations, 0)
    rounds = None if rounds is None else whole("rounds", rounds, 1)
    patience = None if proof_seconds is None else number("proof_seconds", proof_seconds, 0.0)
    took: dict[str, float] = {}
    with phase(took, "bounds"):
        lower = lower_bounds(plant, spec, notes, progress)
        linear = competitors(plant, spec, seed, notes, progress)
        obstruction = no_stabilizing_gain(plant) if spec.inputs is not None else ""
    if obstruction:
        notes.append(obstruction + "; laws with a kink there are not tried")
        progress.say(notes[-1])
    with phase(took, "search and proof"):
        tasks = plan(plant, spec, 0 if obstruction else hidden, activation, kappa, seed, training_seconds, iterations,
                     names, given, left_alone, form, options)
        goal = Goal(floor(lower), tol, 1 if obstruction else rounds, began + progress.seconds)
        found = search(tasks, goal, executor, progress)
    best = _best(found.history)
    with phase(took, "simulation"):
        run = _simulated(plant, spec, best, seed, progress)
    certificate = best.verdict.certificate if best and best.verdict else None
    with phase(took, "rigorous proof"):
        proof = settled(certificate, patience, notes, progress)
    took["in all"] = progress.elapsed
    history = tuple(one.attempt for one in found.history)
    notes += remarks(history, best, found.ended)
    if certificate is None and not obstruction and not plant.full_state:
        notes.append(f"only static laws are tried: {with_memory()}")
    ended = f"{counted(len(history), 'attempt')} in {counted(found.rounds, 'round')}; " + (
        "no other static law is worth trying" if obstruction else found.ended)
    return Result(plant, spec, best.inc if best else None, certificate, proof, run, lower, linear, history, tuple(notes),
                  took, best, ended)


def _best(history: Sequence[Done]) -> Attempt | None:
    """The certified attempt with the lowest certified cost, else the one that simulates best within the limits."""
    certified = best_certified(history)
    if certified is not None:
        return certified.attempt
    return min((one.attempt for one in history if one.attempt.estimate is not None),
               key=lambda one: ordeal(one.estimate), default=None)


def _simulated(plant: Plant, spec: Spec, best: Attempt | None, seed: int, progress: Progress) -> Estimate | None:
    """Simulate from more points than the attempt did, unless its motions do not come to rest anyway or the time is over."""
    if best is None or best.inc is None or best.estimate is None or not best.estimate.settled or progress.is_late:
        return None if best is None else best.estimate
    with progress.during("simulation"):
        return estimate(plant, best.inc, spec, seed=seed)
