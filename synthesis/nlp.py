"""Training as one NLP in CasADi, solved by IPOPT: the objective is NumPy behind callbacks, or a CasADi graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from inc_casadi import graph
from inc_casadi.arrays import Array
from inc_casadi.errors import InvalidInputError
from inc_casadi.plant import Plant

from .ipopt import Stop, Watch, ca, nowhere, options, run
from .objective import Layout, Minimand, Objective
from .outcome import Outcome, Progress, Track
from .rollout import Parameters


def minimize(objective: Minimand, start: Parameters, *, method: str = "adjoint", hessian: str = "gauss-newton",
             max_iterations: int = 100, time_limit: float | None = None, progress: Progress | None = None) -> Outcome:
    """Return the best law that IPOPT finds from a start, within the layout of the objective.

    method: "adjoint" evaluates in NumPy through CasADi callbacks, "graph" in the CasADi graph alone; hessian:
    "gauss-newton" (adjoint only) or "limited-memory"; progress is called with (iteration, cost J, seconds).
    Raises InvalidInputError where "graph" is asked for anything but an `Objective`: no other has a graph.

    A solver that fails is no error: the best accepted iterate comes back with the status. A KeyboardInterrupt ends the
    search with the status "interrupted"; any other exception of `progress` is passed on.
    """
    layout, stop, track = objective.layout, Stop(), Track(progress)
    x = ca.MX.sym("x", layout.size)
    calls = _callbacks(objective, stop)
    value = _graph_of(objective, x) if method == "graph" else calls["value"](x)

    def seen(point: Array, value: float) -> None:
        track.note(layout.parameters(point), objective.scale * float(np.expm1(value)))

    watch = Watch(layout.size, layout.rows.shape[0], seen, stop)
    # The start is feasible and often good: begin close to it instead of at the centre of the norm ball.
    chosen = options(max_iterations, time_limit) | {
        "iteration_callback": watch, "ipopt.mu_init": 1e-3, "ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6,
        "ipopt.max_soc": 0}
    if method == "adjoint" and hessian == "gauss-newton":
        chosen["hess_lag"] = calls["hessian"]
    else:
        chosen |= {"ipopt.hessian_approximation": "limited-memory", "ipopt.limited_memory_max_history": 20}
    problem = {"x": x, "f": value, "g": ca.sparsify(ca.DM(layout.rows)) @ x}
    arguments = {"x0": layout.start(start), "lbx": layout.lower, "lbg": -np.inf, "ubg": layout.kappa}
    status, _ = run(problem, chosen, arguments, stop)
    if stop.failure is not None:
        raise stop.failure
    return track.outcome(start, status)


def _graph_of(objective: Minimand, x: ca.MX) -> ca.MX:
    if not isinstance(objective, Objective):
        raise InvalidInputError(f"a {type(objective).__name__} has no graph: its method is 'adjoint'")
    return graph_value(objective, x)


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


def _dense(rows: int, columns: int = 1) -> ca.Sparsity:
    return ca.Sparsity.dense(rows, columns)


def _callbacks(objective: Minimand, stop: Stop) -> dict[str, _Call]:
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
                 stop: Stop, jacobian: _Call | None = None) -> None:
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
        value: Any = nowhere(self._output.shape)
        with self._stop.guard():
            if not self._stop.requested:
                value = self._function(*(part.full() for part in arguments))
        return [ca.project(ca.DM(value), self._output)]
