"""The verb for plants whose state is not measured: from a plant and a specification to a proved controller with memory."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np

from inc_casadi import INC, Plant, ReLU, Spec
from inc_casadi.activations import Activation
from inc_casadi.arrays import number
from inc_casadi.dynamic import DynamicINC
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.estimate import Estimate
from inc_casadi.sets.rules import whole

from .closing import phase, remarks, settled
from .door import check, names_in, problem
from .dynamic_attempts import DynamicTask
from .dynamic_result import DynamicAttempt, DynamicResult
from .dynamic_rounds import best_of, search_dynamic
from .dynamic_starts import DYNAMIC_STARTS, with_idle_memory
from .dynamic_training import simulated_dynamic
from .lower_bounds import floor, lower_bounds
from .progress import Progress, counted
from .rounds import Goal


def synthesize_dynamic(plant: Any, spec: Spec, *, hidden: int = 8, activation: Activation | None = None,
                       kappa: float = 0.95, seed: int = 0, executor: Executor | None = None, verbose: bool = True,
                       training_seconds: float = 10.0, training_iterations: int = 60, seconds: float | None = None,
                       rounds: int | None = None, tol: float = 1e-3,
                       start: INC | DynamicINC | Sequence[INC | DynamicINC] = (), starts: Sequence[str] | None = None,
                       period: float | None = None, proof_seconds: float | None = None) -> DynamicResult:
    """Return a controller with memory for the plant with proof, or with an honest word on why there is none.

    u_k and xi_{k+1} are one static implicit law of (y_k, xi_k), begun at a fixed xi_0 (`DynamicINC`); its loop with the
    plant is that of a static law on the extended plant with state (x, xi). Candidates are observers under readouts of the
    full state: the Kalman filter of x_0, whose gains differ from step to step (`scheduled_observer`), and steady ones with
    several noises, each with the clipped discounted LQR or with MPC; and the best linear controller of finite order. An NLP
    improves the best of them (`train_dynamic`). Only what passes the gate is called certified: the certificate speaks of the
    motions from (x_0, xi_0) with x_0 anywhere in its set and xi_0 as it is, a flat set of dimension n in R^(n + l), which
    exact pieces follow as such (`dynamic.certify_dynamic`). The certified candidate with the lowest certified cost is
    returned; without any, the one that simulates best, with the reasons.

    Parameters
    ----------
    plant : Plant or control.StateSpace, in discrete time, or in continuous time with `period`
    spec : the cost, initial distribution and input limits
    hidden : units that one training of each two may add, 0 for none
    activation : of those units, ReLU when left out
    kappa : in (0, 1), the well-posedness budget of those units
    seed : of all random choices
    executor : any concurrent.futures.Executor that takes picklable tasks computes the attempts of a round at the same time
    verbose : a line for each thing that is tried, with best certified cost, lower bound, gap and time left
    training_seconds : what one training and one proof may take
    training_iterations : of IPOPT on the coarse nodes
    seconds : budget for bounds and search, counted from the call. The first start is always judged, and the last proof comes
        on top. With it or with `rounds` training goes on with other seeds
    rounds : the most rounds of attempts. Without both, the starts and one round of training
    tol : nothing more is tried within this share of the lower bound on every controller; 0 for never
    start : a controller to begin with besides, or several; a static law takes a state that nothing reads
    starts : names in `DYNAMIC_STARTS` that are tried instead of all
    period : seconds between samples of a continuous plant, as in `synthesize`
    proof_seconds : what the rigorous proof at the end may take, without limit when left out; one that runs out of time is
        none, and the result then holds in floating point only

    Notes
    -----
    Soundness: the extended loop is a rearrangement of plant and controller, to the bit; so what is proved of its motions
    from X_0 x {xi_0} is proved of theirs. The lower bound on any controller holds for controllers with memory too, which see
    no more than the state. Interrupting it (Ctrl-C) returns the best of the attempts that were finished.

    Raises
    ------
    DimensionError, InvalidInputError : arguments that do not fit
    NotStabilizableError : an unstable mode is out of the input's reach
    InfeasibleError : the limits are too small for the initial set

    Examples
    --------
    >>> from inc_casadi import Box
    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])  # no static gain stabilizes it
    >>> spec = Spec(np.eye(2), 0.1, 0.95, Box([-1, -0.5], [1, 0.5]), Box(-0.5, 0.5))
    >>> result = synthesize_dynamic(plant, spec, hidden=0, rounds=1, starts=["filter, clipped LQR"], verbose=False)
    >>> result.status, round(result.cost, 4), bool(result.proof)
    ('certified', 1.2275, True)
    """
    progress, began = Progress(verbose, np.inf if seconds is None else number("seconds", seconds, 0.0)), time.time()
    posed = problem(plant, spec, period)
    plant, spec, notes = posed.plant, posed.spec, [posed.note] if posed.note else []
    activation = ReLU() if activation is None else activation
    check(plant, spec, hidden, activation, kappa)
    given, names = given_controllers(plant, start), names_in("starts", starts, DYNAMIC_STARTS)
    names = tuple(DYNAMIC_STARTS) if names is None else names
    if not names and not given:
        raise InvalidInputError("starts is empty and no start is given, so there is nothing to try")
    iterations = whole("training_iterations", training_iterations, 0)
    template = DynamicTask("", plant, spec, number("training_seconds", training_seconds, 0.0), seed, hidden=hidden,
                           activation=activation, kappa=kappa, iterations=iterations)
    rounds = None if rounds is None else whole("rounds", rounds, 1)
    patience = None if proof_seconds is None else number("proof_seconds", proof_seconds, 0.0)
    took: dict[str, float] = {}
    with phase(took, "bounds"):
        lower = lower_bounds(plant, spec, notes, progress)
    with phase(took, "search and proof"):
        goal = Goal(floor(lower), number("tol", tol, 0.0), rounds, began + progress.seconds)
        found = search_dynamic(_first(template, names, given), goal, executor, progress)
    best = best_of(found.history)
    with phase(took, "simulation"):
        run = _simulated(plant, spec, best, seed, progress)
    certificate = best.verdict.certificate if best and best.verdict else None
    with phase(took, "rigorous proof"):
        proof = settled(certificate, patience, notes, progress)
    took["in all"] = progress.elapsed
    notes += remarks(found.history, best, found.ended)
    ended = f"{counted(len(found.history), 'attempt')} in {counted(found.rounds, 'round')}; {found.ended}"
    return DynamicResult(plant, spec, best.dynamic if best else None, certificate, proof, run, lower, found.history,
                         tuple(notes), took, best, ended)


def given_controllers(plant: Plant, start: INC | DynamicINC | Sequence[INC | DynamicINC]) -> tuple[DynamicINC, ...]:
    """Return the controllers to begin with, each of the plant's measurements and inputs.

    >>> [one.order for one in given_controllers(Plant(1.5, 1.0), INC.linear([[-1.0]]))]
    [1]
    """
    laws = (start,) if isinstance(start, INC | DynamicINC) else tuple(start)
    for law in laws:
        if not isinstance(law, INC | DynamicINC):
            raise InvalidInputError(f"start must be a DynamicINC, an INC or several, not {type(law).__name__}")
        if (law.p, law.m) != (plant.p, plant.m):
            raise DimensionError(f"start maps {law.p} measurements to {law.m} inputs, but the plant has {plant.p} "
                                 f"measurements and {plant.m} inputs")
    return tuple(with_idle_memory(law) if isinstance(law, INC) else law for law in laws)


def _first(template: DynamicTask, names: Sequence[str], given: Sequence[DynamicINC]) -> tuple[DynamicTask, ...]:
    own = [replace(template, name=f"given {i + 1}", dynamic=one) for i, one in enumerate(given)]
    return (*own, *(replace(template, name=name) for name in names))


def _simulated(plant: Plant, spec: Spec, best: DynamicAttempt | None, seed: int, progress: Progress) -> Estimate | None:
    """Simulate from more points than the attempt did, unless its motions do not come to rest anyway or the time is over."""
    if best is None or best.dynamic is None or best.estimate is None or not best.estimate.settled or progress.is_late:
        return None if best is None else best.estimate
    with progress.during("simulation"):
        return simulated_dynamic(plant, spec, best.dynamic, seed=seed)
