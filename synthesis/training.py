"""Improve a start by one nonlinear program: the implicit controller is trained on rollouts from a quadrature."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.arrays import Array, number
from inc_casadi.brief import Brief
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box, Polytope
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .ball import balanced, row_bound
from .input_box import inscribed_box
from .phase_log import PhaseLog
from .phases import Search
from .rollout import Parameters
from .training_options import check_start, form_of, settled
from .training_setup import Setup, setup

_GAIN = 1e-7  # relative; a smaller gain is noise of the estimate, and the start is the simpler law


@dataclass(frozen=True, eq=False)
class Training(Brief):
    """A trained candidate; nothing about it is proved but its well-posedness.

    inc: the law to be used, clipped to the box of inputs (or the bounding box of a polytope) by a saturated readout;
    inner: the law without that readout, as it was trained; cost, start_cost: estimates of the discounted cost of `inc`
    and of the start, both with the input limits and on nodes that training did not see; violation: largest H u - h met
    on the way there when the inputs are a polytope, else 0; state_violation: largest G x - g when states are constrained,
    else 0; iterations: of all phases together; status: how the search ended, in words; seconds: wall time; history: one
    dict(phase, iteration, cost, seconds) per iteration, with the cost on that phase's nodes and horizon. All of these are
    rollouts of the law itself, whatever form the NLP had; form: its name, the one chosen where "auto" was asked for.
    """

    inc: INC
    inner: INC
    cost: float
    start_cost: float
    violation: float
    iterations: int
    status: str
    seconds: float
    history: tuple[dict[str, Any], ...]
    state_violation: float = 0.0
    form: str = ""

    @property
    def improved(self) -> bool:
        """Whether the returned law costs less than the start."""
        return self.cost < self.start_cost

    def plot(self, path: str | Path | None = None, **options: Any) -> Any:
        """Return a Matplotlib figure of cost against iterations and seconds, by phase; written to `path` when given.

        options: `width` and `dpi` of `inc_casadi.plotting.plot_training`.
        """
        from inc_casadi.plotting import plot_training
        return plot_training(self, path, **options)


def train(plant: Any, spec: Spec, start: INC, *, kappa: float = 0.95, horizon: int | None = None,
          order: int | None = None, anchored: bool = True, frozen: Sequence[str] = (),
          terminal: ArrayLike | None = None, form: str = "auto", method: str = "adjoint", hessian: str = "auto",
          steps: str = "spectral", readout: bool = True, states: Box | Polytope | None = None, max_iterations: int = 60,
          time_limit: float | None = None, progress: Callable[[dict[str, Any]], None] | None = None,
          seed: int = 0) -> Training:
    """Return the implicit controller that one NLP makes of a start (eq:training_problem, discounted).

    min sum_i w_i [ sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T x_T'P x_T ] over W, U, V, K, b (and d), where x_0
    is node i of a quadrature of the initial distribution, subject to ||W||_inf <= kappa, which keeps every law well
    posed (prop:projected_training_wp). The input is u = clip(v), v = K y + V eta + d, eta = phi(W eta + U y + b), so a
    box of inputs is kept by construction. Of a polytope the bounding box is; its further half-spaces are penalized and
    tightened until no input outside is seen, which is evidence and no proof; a start that leaves the polytope is first
    saturated to a box inside it. Derivatives are those of prop:implicit_gradients.

    The phases: a horizon of 2 steps, which the terminal cost makes a good guess, when the start is poor; the horizon on
    few nodes; the horizon on more. The best of start and phases on nodes that none of them saw is returned, so training
    never makes it worse there.

    Three forms of the NLP. "shooting": IPOPT on the matrices alone, through rollouts and fixed points, kinks left as they
    are. "lifted": IPOPT on states, preactivations and inputs too, with the loop as constraints; kinks are rounded and the
    rounding is driven to zero; it takes a start that is far off, and constraints on states, but only q up to about 16.
    "projected": gradient steps, W projected on the ball ||W||_inf <= kappa after each (Algorithm 1, step 2). "auto" is the
    form that a further option belongs to, else shooting while its Gauss-Newton Hessian is affordable (up to 8 to 20 units)
    and projected beyond, as measured (`training_options.settled`).

    Parameters
    ----------
    plant : discrete-time Plant or control.StateSpace
    spec : Spec
    start : the inner law to begin with: p measurements, m outputs, q >= 0 hidden units, input limits not built in.
        ||W||_inf may exceed kappa if its units are homogeneous (ReLU) and rescaling them brings it below.
    kappa : bound on ||W||_inf in (0, 1); tighter where an activation is steeper than 1
    horizon : steps T of the rollout; by default until the LQR loop has contracted to a hundredth, within 15 and 50
    order : quadrature points per axis; by default what at most 130 and then 400 nodes allow, random nodes if need be
    anchored : d is not free but -V eta(0), so that u = 0 at y = 0 and the origin stays an equilibrium; only where 0 is
        an admissible input
    frozen : names among W, U, V, K, b, d that keep the values of the start; W is then not bounded by kappa
    terminal : P (n, n) of the terminal cost, positive semidefinite; by default that of the discounted LQR, which for
        measured output is a surrogate: it is the cost that state feedback without limits would still have
    form : "auto", "shooting", "lifted" or "projected"
    method : of shooting: "adjoint", NumPy with batched adjoints through CasADi callbacks, or "graph", CasADi alone:
        slower, for reference
    hessian : of shooting: "gauss-newton" with Levenberg damping, "limited-memory", or "auto": the former while q is small
    steps : of projected gradients: "spectral" with backtracking, or "adam" on a fixed schedule
    readout : of the lifted form: False keeps the inputs at the nodes by constraints H u <= h on the law before its
        readout, instead of training it through the readout; the law that is returned is clipped all the same
    states : of the lifted form: a set that x_1, x_2, ... should keep, hard at the nodes and at the vertices of the initial
        set, tightened as a polytope of inputs is; evidence and no proof
    max_iterations : on the full horizon and few nodes; half as many follow on more nodes, and again for each
        tightening of a polytope; projected gradients take five steps for each
    time_limit : seconds for the search, after which the best law so far is returned; the comparison at the end is extra
    progress : called with dict(phase, iteration, cost, seconds) after each iteration
    seed : of random nodes; with a time limit the result can depend on the machine

    Returns
    -------
    Training. Solver failures, the time limit and KeyboardInterrupt end in its status, with the best law so far.

    Raises
    ------
    InvalidInputError : a continuous plant (use plant.sampled(dt)), kappa outside (0, 1), an unknown option, one that
        belongs to another form, or ||W||_inf of the start above kappa for good
    DimensionError : the start or the spec does not fit the plant
    NotStabilizableError : no controller has a finite cost
    SolverError : CasADi is missing

    Examples
    --------
    >>> from inc_casadi import Box
    >>> from synthesis.starts.random_start import linear_start
    >>> plant = Plant(A=[[1.0, 1.0], [0.0, 1.0]], B=[[0.5], [1.0]])
    >>> spec = Spec(Q=np.eye(2), R=0.1, discount=0.95, initial=Box([-3, -1.5], [3, 1.5]), inputs=Box(-0.5, 0.5))
    >>> start = linear_start([[-0.6, -1.26]], plant, spec, hidden=4)
    >>> result = train(plant, spec, start, horizon=15, order=5, max_iterations=10)
    >>> result.improved, result.inner.well_posedness().norm <= 0.95
    (True, True)
    """
    began = time.perf_counter()
    plant = as_plant(plant)
    _check(plant, spec, start, kappa, frozen)
    chosen = form_of(plant, form, method, hessian, steps, readout, states)
    limit = np.inf if time_limit is None else number("time_limit", time_limit, 0.0)
    pose = partial(_posed, plant, spec, kappa=kappa, horizon=horizon, order=order, anchored=anchored, frozen=frozen,
                   terminal=terminal, seed=seed, states=states)
    problem, law = pose(start)
    if isinstance(spec.inputs, Polytope) and np.any(problem.split(problem.judge(law)[1])[0] > 0.0):
        # From outside the polytope IPOPT rarely comes in: begin with the start saturated to a box inside.
        problem, law = pose(start.with_saturated_output(inscribed_box(spec.inputs)))
    search = Search(problem, settled(chosen, problem), whole("max_iterations", max_iterations, 0),
                    PhaseLog(began, limit, progress))
    laws = [law, *search.run(law)]
    judged = [(cost, *problem.split(rows)) for cost, rows in map(problem.judge, laws)]
    return ended(search.log, laws, judged, problem.inner, problem.box, gain=_GAIN, form=search.form.name)


def _posed(plant: Plant, spec: Spec, start: INC, kappa: float, frozen: Sequence[str],
           **options: Any) -> tuple[Setup, Parameters]:
    start = start if "W" in frozen else balanced(start, row_bound(start.activations, kappa))
    return setup(plant, spec, start, kappa=kappa, frozen=frozen, **options), Parameters.of(start)


def ended(log: PhaseLog, laws: Sequence[Parameters], judged: Sequence[tuple[float, Array, Array]],
          inner: Callable[[Parameters], INC], box: Box | None, *, gain: float, form: str) -> Training:
    """Return the training whose law leaves the sets of inputs and states least, and of several such the cheapest.

    laws: the start, then what the phases ended with; judged: for each of them its cost and the largest H u - h and G x - g
    per half-space, on nodes that no phase saw; inner: makes an INC of a law; box: of inputs, to be built in; gain: share
    of its cost by which the start must be undercut.
    """
    excess = [float(np.max(np.concatenate(parts), initial=0.0)) for _, *parts in judged]
    costs = np.array([cost for cost, _, _ in judged])
    costs[0] *= 1.0 - gain
    best = min(range(len(judged)), key=lambda i: (excess[i], costs[i]))
    law, (cost, inputs, states) = inner(laws[best]), judged[best]
    return Training(
        inc=law if box is None else law.with_saturated_output(box), inner=law, cost=cost, start_cost=judged[0][0],
        violation=float(np.max(inputs, initial=0.0)), iterations=log.iterations,
        status=log.status if best else f"the start is kept ({log.status})", seconds=log.seconds,
        history=tuple(log.history), state_violation=float(np.max(states, initial=0.0)), form=form)


def _check(plant: Plant, spec: Spec, start: INC, kappa: float, frozen: Sequence[str]) -> None:
    if not plant.discrete:
        raise InvalidInputError("training rolls the loop out in discrete time, but the plant is continuous (dt = 0): "
                                "sample it first, plant.sampled(dt)")
    check_start(plant, spec, start, kappa, frozen)
