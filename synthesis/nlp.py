"""The training problem as one NLP in CasADi for IPOPT: variables, norm constraint, objective, derivatives, outcome."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi import graph
from inc_casadi.arrays import Array
from inc_casadi.errors import SolverError
from inc_casadi.plant import Plant

from .rollout import Motion, Parameters, Task, gauss_newton, gradient, input_jacobian, roll

try:
    import casadi as ca
except ImportError as error:
    raise SolverError("training needs CasADi with IPOPT: pip install casadi") from error

STATUS = {
    "Solve_Succeeded": "solved",
    "Solved_To_Acceptable_Level": "solved to acceptable level",
    "Maximum_Iterations_Exceeded": "iteration limit",
    "Maximum_WallTime_Exceeded": "time limit",
    "User_Requested_Stop": "interrupted",
    "Search_Direction_Becomes_Too_Small": "stalled",
    "Feasible_Point_Found": "feasible point found",
    "Restoration_Failed": "stalled",
    "Error_In_Step_Computation": "stalled",
}
_DENSE = ca.Sparsity.dense


@dataclass(frozen=True, eq=False)
class Layout:
    """How the NLP's variables x make up the matrices of the law: theta = fixed + sum of factor * x over `index`.

    W = W+ - W- with W+, W- >= 0, so that the row sums of W+ + W- bound ||W||_inf; the other matrices are scaled to the
    units of measurement and input. theta lists W, U, V, K, b, d, each row by row.

    shapes: of the six matrices; fixed (P,): the entries that are not trained; index, factor (nx,); rows (q, nx): the
    row sums of W+ + W-; kappa: their bound.
    """

    shapes: tuple[tuple[int, ...], ...]
    fixed: Array
    index: np.ndarray
    factor: Array
    rows: Array
    kappa: float

    @classmethod
    def of(cls, law: Parameters, scales: Parameters, frozen: Sequence[str], kappa: float) -> Layout:
        """Return the layout that trains every matrix of `law` whose name is not in `frozen`; scales: units per entry."""
        shapes = tuple(part.shape for part in law)
        flags = np.concatenate([np.full(part.size, name not in frozen) for name, part in law._asdict().items()])
        scale, theta = flat(scales), flat(law)
        W = np.flatnonzero(flags[: law.W.size])
        rest = law.W.size + np.flatnonzero(flags[law.W.size:])
        index = np.concatenate([W, W, rest])
        factor = np.concatenate([scale[W], -scale[W], scale[rest]])
        rows = np.zeros((law.W.shape[0] if W.size else 0, index.size))
        if W.size:
            rows[np.tile(W // law.W.shape[0], 2), np.arange(2 * W.size)] = 1.0
        return cls(shapes, np.where(flags, 0.0, theta), index, factor, rows, kappa)

    @property
    def lower(self) -> Array:
        """Lower bounds of x: zero for W+ and W-, none for the rest."""
        return np.where(np.any(self.rows != 0, axis=0), 0.0, -np.inf) if self.rows.size else np.full(self.index.size, -np.inf)

    def parameters(self, x: Array) -> Parameters:
        """Return the matrices that x stands for."""
        theta = self.fixed + np.bincount(self.index, self.factor * x, self.fixed.size)
        return unflat(theta, self.shapes)

    def start(self, law: Parameters) -> Array:
        """Return an x strictly inside the constraints for a law, whose rows of W are shrunk into the bound if need be."""
        q = law.W.shape[0]
        inside = 0.995 * self.kappa
        norms = np.abs(law.W).sum(axis=1, keepdims=True)
        W = law.W * np.minimum(1.0, inside / np.maximum(norms, 1e-300)) if self.rows.size else law.W
        theta = flat(law._replace(W=W))[self.index] / self.factor
        # W+ and W- both get a little more than they need: the barrier wants an interior, the law does not change.
        spare = 0.5 * (self.kappa - inside) / max(2 * q, 1)
        bounded = np.isfinite(self.lower)
        return np.where(bounded, np.maximum(theta, 0.0) + spare, theta)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What IPOPT came to: the best law it accepted, its status in words, and (iteration, cost, seconds) of each step."""

    law: Parameters
    status: str
    history: tuple[tuple[int, float, float], ...]


def flat(law: Parameters) -> Array:
    """Return the entries of W, U, V, K, b, d, each row by row."""
    return np.concatenate([np.ravel(part) for part in law])


def unflat(theta: Array, shapes: Sequence[tuple[int, ...]]) -> Parameters:
    """Return the matrices whose entries `flat` lists.

    >>> unflat(np.arange(6.0), [(1, 1)] * 4 + [(1,)] * 2).d.tolist()
    [5.0]
    """
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    return Parameters(*(part.reshape(shape) for part, shape in zip(np.split(theta, ends[:-1]), shapes, strict=True)))


class Evaluator:
    """The objective log(1 + J / scale) of a task and its derivatives, from batched NumPy rollouts.

    The logarithm has the minimizers of J and keeps the cost of a diverging law within reach of a line search. The last
    rollout is kept, since IPOPT asks for value, gradient and Hessian at one point in turn, and its hidden units start
    the next fixed point.
    """

    def __init__(self, task: Task, layout: Layout, scale: float, limits: tuple[Array, Array] | None = None) -> None:
        self.task, self.layout, self.scale, self.limits = task, layout, scale, limits
        self.stopped = False
        self.values = 0
        self._damping, self._values_at_hessian = 1e-3, 0
        self._key = b""
        self._motion: Motion | None = None
        self._law: Parameters | None = None
        self._guess: Array | None = None

    def motion(self, x: Array) -> Motion:
        """Return the rollout at x."""
        if self._motion is None or self._key != x.tobytes():
            self._law = self.layout.parameters(x)
            self._motion, self._key = roll(self.task, self._law, self._guess), x.tobytes()
            self._guess = self._motion.eta if np.isfinite(self._motion.cost) else None
            self.values += 1
        return self._motion

    def value(self, x: Array) -> float:
        """Return log(1 + J / scale), NaN where the loop is lost, so that the line search steps back."""
        cost = self.motion(x).cost
        return float(np.log1p(cost / self.scale)) if np.isfinite(cost) else np.nan

    def gradient(self, x: Array) -> Array:
        """Return the gradient of `value` (nx,)."""
        motion = self.motion(x)
        return self._to_x(flat(gradient(self.task, self._law, motion))) / (self.scale + motion.cost)

    def hessian(self, x: Array) -> Array:
        """Return the damped Gauss-Newton Hessian of `value` (nx, nx).

        The damping of Levenberg and Marquardt falls while IPOPT takes full steps and rises when it has to step back.
        """
        motion = self.motion(x)
        trials = self.values - self._values_at_hessian
        self._values_at_hessian = self.values
        self._damping = float(np.clip(self._damping * (0.5 if trials <= 1 else 2.0 if trials > 2 else 1.0), 1e-5, 1e-1))
        H = gauss_newton(self.task, self._law, motion)[np.ix_(self.layout.index, self.layout.index)]
        H = H * np.outer(self.layout.factor, self.layout.factor) / (self.scale + motion.cost)
        return H + self._damping * np.eye(x.size)

    def excess(self, x: Array) -> Array:
        """Return H u - h at every step and node, flat; nonpositive where the input is admissible."""
        assert self.limits is not None
        H, h = self.limits
        return (self.motion(x).u @ H.T - h).ravel()

    def excess_jacobian(self, x: Array) -> Array:
        """Return the Jacobian of `excess` (rows, nx)."""
        assert self.limits is not None
        motion = self.motion(x)
        full = self.limits[0] @ input_jacobian(self.task, self._law, motion)
        return full.reshape(-1, full.shape[-1])[:, self.layout.index] * self.layout.factor

    def _to_x(self, theta: Array) -> Array:
        return theta[self.layout.index] * self.layout.factor


def minimize(evaluator: Evaluator, start: Parameters, *, method: str = "adjoint", hessian: str = "gauss-newton",
             max_iterations: int = 100, time_limit: float | None = None,
             progress: Callable[[int, float, float], None] | None = None) -> Outcome:
    """Return what IPOPT makes of the start: minimize the evaluator's objective over its layout.

    method: "adjoint" evaluates by NumPy through CasADi callbacks, "graph" by the CasADi graph alone; hessian:
    "gauss-newton" (adjoint only) or "limited-memory"; progress is called with (iteration, cost J, seconds).

    A failing solver is no error: the best accepted iterate comes back with the status. A KeyboardInterrupt ends the
    search with the status "interrupted"; any other exception of `progress` is passed on.
    """
    layout = evaluator.layout
    x = ca.MX.sym("x", layout.index.size)
    watch = _Watch(evaluator, progress)
    options: dict[str, Any] = _options(max_iterations, time_limit) | {"iteration_callback": watch}
    if method == "graph":
        objective, excess = graph_objective(evaluator, x)
    else:
        calls = _callbacks(evaluator)
        objective = calls["value"](x)
        excess = calls["excess"](x) if "excess" in calls else ca.MX(0, 1)
    if method == "adjoint" and hessian == "gauss-newton":
        options["hess_lag"] = calls["hessian"]
    else:
        options |= {"ipopt.hessian_approximation": "limited-memory", "ipopt.limited_memory_max_history": 20}
    rows = layout.rows.shape[0]
    upper = np.concatenate([np.full(rows, layout.kappa), np.zeros(excess.numel())])
    problem = {"x": x, "f": objective, "g": ca.vertcat(ca.sparsify(ca.DM(layout.rows)) @ x, excess)}
    try:
        solver = ca.nlpsol("training", "ipopt", problem, options)
        solver(x0=layout.start(start), lbx=layout.lower, lbg=-np.inf, ubg=upper)
        status = STATUS.get(solver.stats()["return_status"], f"failed: {solver.stats()['return_status']}")
    except KeyboardInterrupt:
        evaluator.stopped = True
    except RuntimeError as error:
        status = f"failed: {str(error).strip().splitlines()[-1]}"
    if watch.failure is not None:
        raise watch.failure
    status = "interrupted" if evaluator.stopped else status
    return Outcome(start if watch.best is None else layout.parameters(watch.best), status, tuple(watch.history))


def graph_objective(evaluator: Evaluator, x: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return the objective and the input excess as pure CasADi expressions of x, the reference for `Evaluator`.

    The fixed point is a rootfinder, time a `mapaccum`, the samples a `map`; derivatives are CasADi's own.
    """
    task, layout = evaluator.task, evaluator.layout
    size = layout.index.size
    entries = ca.DM.triplet(layout.index.tolist(), list(range(size)), ca.DM(layout.factor), layout.fixed.size, size)
    theta = ca.DM(layout.fixed) + entries @ x
    ends = np.cumsum([0] + [int(np.prod(shape)) for shape in layout.shapes])
    parts = [theta[int(low):int(high)] for low, high in zip(ends[:-1], ends[1:], strict=True)]
    law = [ca.reshape(part, shape[1], shape[0]).T if len(shape) == 2 else part
           for part, shape in zip(parts, layout.shapes, strict=True)]
    (m, q), p = layout.shapes[2], task.C.shape[0]
    inner = graph.parametric_inc(q, p, m, task.units)
    if task.anchored:
        law[5] = -inner(np.zeros(p), *law[:5], np.zeros(m))[0]
    symbols = [ca.MX.sym(inner.name_in(i), inner.sparsity_in(i)) for i in range(inner.n_in())]
    limited = ca.fmin(ca.fmax(inner(*symbols)[0], task.lower), task.upper)
    controller = ca.Function("limited", symbols, [limited], inner.name_in(), ["u"])
    states, inputs = graph.rollout(Plant(task.A, task.B, task.C), controller, task.steps, task.weights.size)(
        ca.DM(task.nodes), *law)
    stage = np.outer(task.weights, task.discount ** np.arange(task.steps + 1))
    last = np.zeros_like(stage)
    last[:, -1], stage[:, -1] = stage[:, -1], 0.0
    cost = (_weighted(states, task.Q, stage) + _weighted(states, task.terminal, last)
            + _weighted(inputs, task.R, stage[:, :-1]))
    if evaluator.limits is None:
        return ca.log(1 + cost / evaluator.scale), ca.MX(0, 1)
    H, h = evaluator.limits
    return ca.log(1 + cost / evaluator.scale), ca.vec(ca.DM(H) @ inputs - ca.repmat(ca.DM(h), 1, inputs.shape[1]))


def _weighted(points: ca.MX, weight: Array, factors: Array) -> ca.MX:
    """sum_j factors_j points_j' weight points_j over the columns of points."""
    rows = np.broadcast_to(factors.reshape(1, -1), (weight.shape[0], factors.size))
    return ca.dot(points * ca.DM(rows), ca.DM(weight) @ points)


def _options(max_iterations: int, time_limit: float | None) -> dict[str, Any]:
    options: dict[str, Any] = {
        "print_time": False, "show_eval_warnings": False, "calc_lam_p": False,
        "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": max_iterations, "ipopt.tol": 1e-7,
        # The start is feasible and often good: begin close to it instead of at the centre of the norm ball.
        "ipopt.mu_init": 1e-3, "ipopt.bound_push": 1e-6, "ipopt.bound_frac": 1e-6,
    }
    if time_limit is not None:
        options["ipopt.max_wall_time"] = max(time_limit, 1e-3)
    return options


class _Call(ca.Callback):
    """A NumPy function of x as a CasADi Function; the first input is x, others are multipliers or known outputs."""

    def __init__(self, name: str, function: Callable[..., Array], inputs: Sequence[ca.Sparsity], output: ca.Sparsity,
                 evaluator: Evaluator, jacobian: _Call | None = None) -> None:
        super().__init__()
        self._function, self._inputs, self._output = function, inputs, output
        self._evaluator, self._jacobian = evaluator, jacobian
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Number of inputs."""
        return len(self._inputs)

    def get_n_out(self) -> int:
        """One output."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Shape of input i."""
        return self._inputs[i]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Shape of the output."""
        return self._output

    def has_jacobian(self) -> bool:
        """Whether the derivative is provided."""
        return self._jacobian is not None

    def get_jacobian(self, name: str, inames: list[str], onames: list[str], opts: dict[str, Any]) -> ca.Function:
        """Return the derivative, a callback that this one keeps alive."""
        assert self._jacobian is not None
        return self._jacobian

    def eval(self, arguments: list[ca.DM]) -> list[ca.DM]:
        """Evaluate; after an interruption every value is NaN, which ends IPOPT's search soon."""
        value: Any = np.full(self._output.shape, np.nan)
        try:
            if not self._evaluator.stopped:
                value = self._function(*(part.full() for part in arguments))
        except KeyboardInterrupt:
            self._evaluator.stopped = True
        except np.linalg.LinAlgError:
            pass  # a singular I - D W outside the norm bound: not a point that IPOPT may accept
        return [ca.project(ca.DM(value), self._output)]


def _callbacks(evaluator: Evaluator) -> dict[str, _Call]:
    size, rows = evaluator.layout.index.size, evaluator.layout.rows.shape[0]
    x, one = _DENSE(size, 1), _DENSE(1, 1)
    slope = _Call("gradient", lambda x, _: evaluator.gradient(x.ravel())[None], [x, one], _DENSE(1, size), evaluator)
    calls = {"value": _Call("value", lambda x: np.array([[evaluator.value(x.ravel())]]), [x], one, evaluator, slope)}
    if evaluator.limits is not None:
        count = evaluator.limits[1].size * evaluator.task.steps * evaluator.task.weights.size
        slope = _Call("excess_jacobian", lambda x, _: evaluator.excess_jacobian(x.ravel()), [x, _DENSE(count, 1)],
                      _DENSE(count, size), evaluator)
        calls["excess"] = _Call("excess", lambda x: evaluator.excess(x.ravel())[:, None], [x], _DENSE(count, 1),
                                evaluator, slope)
        rows += count
    # IPOPT's signature of the Hessian of the Lagrangian: (x, p, multiplier of f, multipliers of g).
    calls["hessian"] = _Call("hessian", lambda x, p, factor, g: factor * evaluator.hessian(x.ravel()),
                             [x, _DENSE(0, 0), one, _DENSE(rows, 1)], ca.Sparsity.upper(size), evaluator)
    return calls


class _Watch(ca.Callback):
    """Called by IPOPT after each step: keeps the best accepted iterate and the history, and can stop the search."""

    def __init__(self, evaluator: Evaluator, progress: Callable[[int, float, float], None] | None) -> None:
        super().__init__()
        self._evaluator, self._progress = evaluator, progress
        self._began, self._least = time.perf_counter(), np.inf
        self._size = evaluator.layout.index.size
        self._rows = evaluator.layout.rows.shape[0]
        task = evaluator.task
        self._more = 0 if evaluator.limits is None else evaluator.limits[1].size * task.steps * task.weights.size
        self.best: Array | None = None
        self.history: list[tuple[int, float, float]] = []
        self.failure: BaseException | None = None
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """The outputs of an NLP solver are the inputs of its watch."""
        return ca.nlpsol_n_out()

    def get_n_out(self) -> int:
        """One flag."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Shapes of x, f, g and their multipliers."""
        sizes = {"f": 1, "x": self._size, "lam_x": self._size, "lam_p": 0}
        return _DENSE(sizes.get(ca.nlpsol_out(i), self._rows + self._more), 0 if ca.nlpsol_out(i) == "lam_p" else 1)

    def eval(self, arguments: list[ca.DM]) -> list[int]:
        """Record the iterate; return 1 to stop."""
        x, f, g = (part.full().ravel() for part in arguments[:3])
        cost = self._evaluator.scale * float(np.expm1(f[0]))
        admissible = not self._more or float(np.max(g[self._rows:])) <= 1e-6
        if cost < self._least and admissible:
            self.best, self._least = x, cost
        self.history.append((len(self.history), cost, time.perf_counter() - self._began))
        finished = self._progress is None
        try:
            if self._progress is not None:
                self._progress(*self.history[-1])
                finished = True
        except KeyboardInterrupt:
            self._evaluator.stopped = finished = True
        finally:
            if not finished:
                self.failure = sys.exc_info()[1]
        return [int(self._evaluator.stopped)]
