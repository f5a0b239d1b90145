"""Training as one NLP in CasADi, solved by IPOPT: the objective is NumPy behind callbacks, or a CasADi graph."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi import graph
from inc_casadi.arrays import Array
from inc_casadi.errors import SolverError
from inc_casadi.plant import Plant

from .objective import Layout, Objective
from .rollout import Parameters

try:
    import casadi as ca
except ImportError as error:
    raise SolverError("training needs CasADi with IPOPT: pip install casadi") from error

STATUS = {
    "Solve_Succeeded": "solved",
    "Solved_To_Acceptable_Level": "no more progress",
    "Search_Direction_Becomes_Too_Small": "no more progress",
    "Restoration_Failed": "no more progress",
    "Error_In_Step_Computation": "no more progress",
    "Maximum_Iterations_Exceeded": "iteration limit",
    "Maximum_WallTime_Exceeded": "time limit",
    "User_Requested_Stop": "interrupted",
}
Progress = Callable[[int, float, float], None]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What IPOPT came to: the best law it accepted, the status in words, and (iteration, cost, seconds) per step."""

    law: Parameters
    status: str
    history: tuple[tuple[int, float, float], ...]


@dataclass
class _Stop:
    """Whether the search is to end, and why if by an error; shared by the callbacks of one solve."""

    requested: bool = False
    failure: BaseException | None = None

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Turn what is raised inside into a request to stop: CasADi would print and forget it."""
        try:
            yield
        except KeyboardInterrupt:
            self.requested = True
        except BaseException as error:  # not swallowed: raised again when the solver has returned
            self.requested, self.failure = True, error


def minimize(objective: Objective, start: Parameters, *, method: str = "adjoint", hessian: str = "gauss-newton",
             max_iterations: int = 100, time_limit: float | None = None, progress: Progress | None = None) -> Outcome:
    """Return the best law that IPOPT finds from a start, within the layout of the objective.

    method: "adjoint" evaluates in NumPy through CasADi callbacks, "graph" in the CasADi graph alone; hessian:
    "gauss-newton" (adjoint only) or "limited-memory"; progress is called with (iteration, cost J, seconds).

    A solver that fails is no error: the best accepted iterate comes back with the status. A KeyboardInterrupt ends the
    search with the status "interrupted"; any other exception of `progress` is passed on.
    """
    layout, stop = objective.layout, _Stop()
    x = ca.MX.sym("x", layout.size)
    calls = _callbacks(objective, stop)
    watch = _Watch(objective, stop, progress)
    options = _options(max_iterations, time_limit) | {"iteration_callback": watch}
    if method == "adjoint" and hessian == "gauss-newton":
        options["hess_lag"] = calls["hessian"]
    else:
        options |= {"ipopt.hessian_approximation": "limited-memory", "ipopt.limited_memory_max_history": 20}
    problem = {"x": x, "f": graph_value(objective, x) if method == "graph" else calls["value"](x),
               "g": ca.sparsify(ca.DM(layout.rows)) @ x}
    status = _run(problem, options, layout, layout.start(start), stop)
    if stop.failure is not None:
        raise stop.failure
    return Outcome(start if watch.best is None else layout.parameters(watch.best), status, tuple(watch.history))


def _run(problem: dict[str, ca.MX], options: dict[str, Any], layout: Layout, x0: Array, stop: _Stop) -> str:
    status = "interrupted"
    try:
        solver = ca.nlpsol("training", "ipopt", problem, options)
        solver(x0=x0, lbx=layout.lower, lbg=-np.inf, ubg=layout.kappa)
        returned = solver.stats()["return_status"]
        status = STATUS.get(returned, f"failed: {returned}")
    except KeyboardInterrupt:
        stop.requested = True
    except RuntimeError as error:
        status = f"failed: {str(error).strip().splitlines()[-1]}"
    return "interrupted" if stop.requested else status


def graph_value(objective: Objective, x: ca.MX) -> ca.MX:
    """Return the value of an objective as a pure CasADi expression of x, the reference for the one in NumPy.

    The fixed point is a rootfinder, time a `mapaccum`, the samples a `map`; derivatives are CasADi's own.
    """
    scenario, N = objective.scenario, objective.scenario.weights.size
    law = _law(objective.layout, x)
    (m, q), p = objective.layout.shapes[2], scenario.C.shape[0]
    inner = graph.parametric_inc(q, p, m, scenario.units)
    if scenario.anchored:
        law[5] = -inner(np.zeros(p), *law[:5], np.zeros(m))[0]
    symbols = [ca.MX.sym(inner.name_in(i), inner.sparsity_in(i)) for i in range(inner.n_in())]
    limited = ca.fmin(ca.fmax(inner(*symbols)[0], scenario.lower), scenario.upper)
    controller = ca.Function("limited", symbols, [limited], inner.name_in(), ["u"])
    loop = graph.rollout(Plant(scenario.A, scenario.B, scenario.C), controller, scenario.steps, N)
    states, inputs = loop(ca.DM(scenario.nodes), *law)
    stage = np.outer(scenario.weights, scenario.discount ** np.arange(scenario.steps + 1))
    last = np.zeros_like(stage)
    last[:, -1], stage[:, -1] = stage[:, -1], 0.0
    cost = (_weighted(states, scenario.Q, stage) + _weighted(states, scenario.terminal, last)
            + _weighted(inputs, scenario.R, np.outer(scenario.weights, scenario.discount ** np.arange(scenario.steps))))
    if scenario.h.size:
        outside = ca.fmax(ca.DM(scenario.H) @ inputs - ca.repmat(ca.DM(scenario.h), 1, inputs.shape[1]), 0)
        share = np.outer(np.full(N, scenario.penalty / N), scenario.discount ** np.arange(scenario.steps))
        cost += _weighted(outside, np.eye(scenario.h.size), share)
    return ca.log(1 + cost / objective.scale)


def _law(layout: Layout, x: ca.MX) -> list[ca.MX]:
    """W, U, V, K, b, d as expressions of x."""
    columns = list(range(layout.size))
    entries = ca.DM.triplet(layout.index.tolist(), columns, ca.DM(layout.factor), layout.fixed.size, layout.size)
    theta = ca.DM(layout.fixed) + entries @ x
    ends = np.cumsum([0] + [int(np.prod(shape)) for shape in layout.shapes]).tolist()
    parts = [theta[low:high] for low, high in zip(ends[:-1], ends[1:], strict=True)]
    return [ca.reshape(part, shape[1], shape[0]).T if len(shape) == 2 else part
            for part, shape in zip(parts, layout.shapes, strict=True)]


def _weighted(points: ca.MX, weight: Array, factors: Array) -> ca.MX:
    """sum_j factors_j points_j' weight points_j over the columns of points."""
    rows = np.broadcast_to(factors.reshape(1, -1), (weight.shape[0], factors.size))
    return ca.dot(points * ca.DM(rows), ca.DM(weight) @ points)


def _options(max_iterations: int, time_limit: float | None) -> dict[str, Any]:
    options: dict[str, Any] = {
        "print_time": False, "show_eval_warnings": False, "calc_lam_p": False,
        "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": max_iterations, "ipopt.tol": 1e-7,
        # The start is feasible and often good: begin close to it instead of at the centre of the norm ball.
        "ipopt.mu_init": 1e-3, "ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6, "ipopt.max_soc": 0,
        # At a kink the optimality conditions of a smooth NLP are never met: end where the objective stands still.
        "ipopt.acceptable_iter": 10, "ipopt.acceptable_obj_change_tol": 1e-6, "ipopt.acceptable_tol": 1e3,
        "ipopt.acceptable_dual_inf_tol": 1e3, "ipopt.acceptable_compl_inf_tol": 1e3,
    }
    if time_limit is not None:
        options["ipopt.max_wall_time"] = max(time_limit, 1e-3)
    return options


def _dense(rows: int, columns: int = 1) -> ca.Sparsity:
    return ca.Sparsity.dense(rows, columns)


def _callbacks(objective: Objective, stop: _Stop) -> dict[str, _Call]:
    size = objective.layout.size
    x, one = _dense(size), _dense(1)
    slope = _Call("gradient", lambda x, _: objective.gradient(x.ravel())[None], [x, one], _dense(1, size), stop)
    calls = {"value": _Call("value", lambda x: np.full((1, 1), objective.value(x.ravel())), [x], one, stop, slope)}
    # IPOPT's Hessian of the Lagrangian takes x, no parameters, the multiplier of the objective, and those of g.
    calls["hessian"] = _Call("hessian", lambda x, p, factor, g: factor * objective.hessian(x.ravel()),
                             [x, _dense(0, 0), one, _dense(objective.layout.rows.shape[0])],
                             ca.Sparsity.upper(size), stop)
    return calls


class _Call(ca.Callback):
    """A NumPy function as a CasADi Function, with its Jacobian as another; both must be kept alive while in use."""

    def __init__(self, name: str, function: Callable[..., Array], inputs: Sequence[ca.Sparsity], output: ca.Sparsity,
                 stop: _Stop, jacobian: _Call | None = None) -> None:
        super().__init__()
        self._function, self._inputs, self._output = function, inputs, output
        self._stop, self._jacobian = stop, jacobian
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._inputs[i]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._output

    def has_jacobian(self) -> bool:
        return self._jacobian is not None

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> ca.Function:
        assert self._jacobian is not None
        return self._jacobian

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        # NaN tells IPOPT's line search to step back, and after an interruption ends the search.
        value: Any = np.full(self._output.shape, np.nan)
        with self._stop.guard():
            if not self._stop.requested:
                value = self._function(*(part.full() for part in arguments))
        return [ca.project(ca.DM(value), self._output)]


class _Watch(ca.Callback):
    """Called by IPOPT after each step: keeps the best accepted iterate and the history, and can end the search."""

    def __init__(self, objective: Objective, stop: _Stop, progress: Progress | None) -> None:
        super().__init__()
        self._scale, self._size, self._rows = objective.scale, objective.layout.size, objective.layout.rows.shape[0]
        self._stop, self._progress = stop, progress
        self._began, self._least = time.perf_counter(), np.inf
        self.best: Array | None = None
        self.history: list[tuple[int, float, float]] = []
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        shapes = {"f": (1,), "x": (self._size,), "lam_x": (self._size,), "lam_p": (0, 0)}
        return _dense(*shapes.get(ca.nlpsol_out(i), (self._rows,)))

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        x, cost = arguments[0].full().ravel(), self._scale * float(np.expm1(float(arguments[1])))
        if cost < self._least:
            self.best, self._least = x, cost
        self.history.append((len(self.history), cost, time.perf_counter() - self._began))
        with self._stop.guard():
            if self._progress is not None:
                self._progress(*self.history[-1])
        return [ca.DM(int(self._stop.requested))]
