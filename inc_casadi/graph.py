"""The controller and its closed loop as CasADi graphs: the fixed point is an implicit function, derivatives are exact.

A graph is differentiated by the implicit function theorem, which is prop:implicit_gradients. Two warnings. At a kink
CasADi differentiates fmax(z, 0) to 0.5, neither of the one-sided slopes: never linearize a controller at a kink (for a
law without bias the origin is one) through its graph, but use `INC.jacobian`, which takes the slope on the right. And
a rootfinder does not say when it fails: `residual_function` does, and `well_posed.error_from_residual` turns the residual
into a bound on the error of eta (for slopes within [-1, 1] and ||W||_inf < 1, the largest residual over 1 - ||W||_inf).
The implicit function theorem applies wherever a test of well-posedness holds: then I - DW is nonsingular for every D of
slopes, half-way slopes at kinks included. Where only the test with a multiplier T holds, full Newton steps from phi(r) may
cycle: the graph of such a controller first takes splitting iterations, which converge, and Newton's steps polish.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import Any

import numpy as np

from .activations import Activation
from .activations.stack import Units, as_units, groups, slopes
from .arrays import Array, number
from .errors import InvalidInputError, SolverError
from .fixed_point import feedforward_levels
from .inc import INC
from .plant import Plant, as_plant
from .splitting import prepare

try:
    import casadi as ca
except ImportError as error:
    raise SolverError("the graph of a controller needs CasADi: pip install casadi") from error

# fast_newton takes full Newton steps; for eta = phi(W eta + r) with ||W||_inf <= 0.999 it ended within 9 of them in two
# million random cases, piecewise-affine and cyclic ones included.
_ROOTFINDER = {"abstol": 1e-12, "abstolStep": 0.0, "max_iter": 100}
_GUESS, _LONGEST_GUESS = 1e-9, 5000  # distance to the fixed point that splitting leaves to Newton, and its most steps
_serial = count()


def inc_function(inc: INC, *, smoothing: float = 0.0) -> ca.Function:
    """Return the controller as a CasADi Function y -> (u, eta).

    u = K y + V eta + d with eta = phi(W eta + U y + b): one pass when W is feedforward (the Function is then built from
    scalars and expands into C code), else a Newton rootfinder whose derivative is the implicit function theorem's. At a
    kink CasADi's derivative is 0.5 between the slopes: see the module's warning.

    Parameters
    ----------
    inc : the controller, its matrices become constants
    smoothing : width eps of the rounded kinks, see `activation_graph`; 0 for the law itself

    Raises
    ------
    InvalidInputError : smoothing is negative

    Examples
    --------
    >>> law = inc_function(INC(W=[[0.5]], U=[[1.0]], V=[[-1.0]], K=[[0.0]]))
    >>> law(1.0)[0].full().round(9).tolist()
    [[-2.0]]
    """
    levels = feedforward_levels(inc.W)
    symbol: Any = ca.MX if levels is None else ca.SX
    y = symbol.sym("y", inc.p)
    r = ca.DM(inc.U) @ y + ca.DM(inc.b)
    if levels is None:
        T = inc.well_posedness().T
        guess = None if T is None else _split(inc, T, smoothing)
        eta = _implicit(inc.activations, smoothing, guess)(r, ca.DM(inc.W))
    else:
        eta = _one_pass(inc.activations, inc.W, r, levels, smoothing)
    u = ca.DM(inc.K) @ y + ca.DM(inc.V) @ eta + ca.DM(inc.d)
    return ca.Function("inc", [y], [u, eta], ["y"], ["u", "eta"])


def parametric_inc(q: int, p: int, m: int, activations: Activation | Sequence[Activation],
                   smoothing: float = 0.0) -> ca.Function:
    """Return the Function (y, W, U, V, K, b, d) -> (u, eta), differentiable in the measurement and in every matrix.

    Parameters
    ----------
    q, p, m : numbers of hidden units, measurements and outputs; q may be 0
    activations : one for all hidden units, or one per unit
    smoothing : width eps of the rounded kinks, 0 for none

    Raises
    ------
    DimensionError : the number of activations is not q
    InvalidInputError : smoothing is negative

    Examples
    --------
    >>> from inc_casadi.activations import ReLU
    >>> law = parametric_inc(1, 1, 1, ReLU())
    >>> law(1.0, 0.5, 1.0, -1.0, 0.0, 0.0, 0.0)[0].full().round(9).tolist()
    [[-2.0]]
    """
    units = as_units(activations, q)
    y, W, U = ca.MX.sym("y", p), ca.MX.sym("W", q, q), ca.MX.sym("U", q, p)
    V, K, b, d = ca.MX.sym("V", m, q), ca.MX.sym("K", m, p), ca.MX.sym("b", q), ca.MX.sym("d", m)
    eta = _implicit(units, smoothing)(U @ y + b, W) if q else ca.MX(0, 1)
    u = K @ y + V @ eta + d if q else K @ y + d
    return ca.Function("parametric_inc", [y, W, U, V, K, b, d], [u, eta], ["y", "W", "U", "V", "K", "b", "d"],
                       ["u", "eta"])


def residual_function(activations: Sequence[Activation], smoothing: float = 0.0) -> ca.Function:
    """Return the Function (eta, r, W) -> eta - phi(W eta + r), zero at the fixed point of preactivation r = U y + b.

    Parameters
    ----------
    activations : one per hidden unit
    smoothing : width eps of the rounded kinks, 0 for none

    Examples
    --------
    >>> from inc_casadi.activations import ReLU
    >>> residual_function([ReLU()])(2.5, 1.0, 0.5).full().tolist()
    [[0.25]]
    """
    units = tuple(activations)
    q = len(units)
    eta, r, W = ca.MX.sym("eta", q), ca.MX.sym("r", q), ca.MX.sym("W", q, q)
    residual = eta - units_graph(units, W @ eta + r, smoothing)
    return ca.Function("residual", [eta, r, W], [residual], ["eta", "r", "W"], ["residual"])


def activation_graph(activation: Activation, z: Any, smoothing: float = 0.0) -> Any:
    """Return phi(z) as a CasADi expression, its kinks rounded over a width `smoothing` = eps.

    With slopes s_j, kinks t_j and the leftmost piece s_0 z + c_0, a piecewise-affine unit is
    s_0 z + c_0 + sum_j (s_{j+1} - s_j) max(z - t_j, 0), and max(r, 0) becomes (r + sqrt(r^2 + eps^2)) / 2. A constant
    keeps phi(0) as it was, so that an equilibrium at the origin stays one; slopes stay within those of phi, and the
    error is at most eps sum_j |s_{j+1} - s_j|. Smooth activations are returned as they are.

    Parameters
    ----------
    activation : one unit's activation
    z : a CasADi expression of any shape
    smoothing : eps >= 0, in the units of z

    Examples
    --------
    >>> from inc_casadi.activations import ReLU
    >>> rounded = activation_graph(ReLU(), ca.DM([0.0, 3.0]), 8.0)
    >>> rounded.full().round(6).ravel().tolist()
    [0.0, 1.772002]
    """
    eps = number("smoothing", smoothing, 0.0)
    pieces = activation.pieces
    if eps == 0.0 or pieces is None or pieces.kinks.size == 0:
        return activation.formula(z, ca)
    steps = np.diff(pieces.slopes)
    ramps = [step * (z - kink + ca.sqrt((z - kink) ** 2 + eps**2)) / 2
             for step, kink in zip(steps, pieces.kinks, strict=True)]
    at_zero = pieces.intercepts[0] + steps @ (-pieces.kinks + np.sqrt(pieces.kinks**2 + eps**2)) / 2
    kept = float(activation(0.0)) - at_zero
    return pieces.slopes[0] * z + (pieces.intercepts[0] + kept) + sum(ramps[1:], ramps[0])


def rollout(plant: Plant, controller: ca.Function, steps: int, samples: int = 1) -> ca.Function:
    """Return the Function (x0, parameters...) -> (x, u) of the closed loop: `mapaccum` in time, `map` over samples.

    x+ = A x + B u with u the controller's first output at y = C x; further inputs of the controller (the matrices of
    `parametric_inc`) are held over all steps and samples and become inputs of the rollout.

    Parameters
    ----------
    plant : a discrete-time Plant or control.StateSpace
    controller : Function (y, ...) -> (u, ...), such as `inc_function(inc)` or `parametric_inc(...)`
    steps : number of steps T >= 1
    samples : number N of initial states

    Returns
    -------
    Function from x0 (n, N) to x (n, N (T+1)) and u (m, N T), sample by sample: `x.full().reshape(n, N, T + 1)` is laid
    out like the states of `simulate`.

    Raises
    ------
    InvalidInputError : the plant is in continuous time, or there is no step or no sample

    Examples
    --------
    >>> run = rollout(Plant([[1.5]], [[1.0]]), inc_function(INC.saturated([[-1.5]], 1.0)), 2)
    >>> run(1.0)[0].full().tolist()
    [[1.0, 0.5, 0.0]]
    """
    plant = as_plant(plant)
    if not plant.discrete:
        raise InvalidInputError("a rollout steps through discrete time: sample the plant first, plant.sampled(dt)")
    if steps < 1 or samples < 1:
        raise InvalidInputError(f"a rollout needs at least one step and one sample, not {steps} and {samples}")
    x = ca.MX.sym("x", plant.n)
    held = [ca.MX.sym(controller.name_in(i), controller.sparsity_in(i)) for i in range(1, controller.n_in())]
    u = controller(ca.DM(plant.C) @ x, *held)
    u = u[0] if controller.n_out() > 1 else u
    step = ca.Function("step", [x, *held], [ca.DM(plant.A) @ x + ca.DM(plant.B) @ u, u])
    states, inputs = step.mapaccum("motion", steps)(x, *[ca.repmat(part, 1, steps) for part in held])
    single = ca.Function("single", [x, *held], [ca.horzcat(x, states), inputs])
    start = ca.MX.sym("x0", plant.n, samples)
    fixed = list(range(1, controller.n_in()))
    outputs = single.map("samples", "serial", samples, fixed, [])(start, *held) if samples > 1 else single(start, *held)
    names = [controller.name_in(i) for i in fixed]
    return ca.Function("rollout", [start, *held], list(outputs), ["x0", *names], ["x", "u"])


def _implicit(units: Units, smoothing: float, guess: ca.Function | None = None) -> ca.Function:
    """The Function (r, W) -> eta = phi(W eta + r); Newton starts from phi(r), or from guess(r)."""
    q = len(units)
    r, W = ca.MX.sym("r", q), ca.MX.sym("W", q, q)
    solver = ca.rootfinder(f"fixed_point_{next(_serial)}", "fast_newton", residual_function(units, smoothing),
                           dict(_ROOTFINDER))
    start = units_graph(units, r, smoothing) if guess is None else guess(r)
    return ca.Function("hidden", [r, W], [solver(start, r, W)], ["r", "W"], ["eta"])


def _split(inc: INC, T: Array, smoothing: float) -> ca.Function:
    """The Function r -> eta after as many splitting iterations as shrink any error to 1e-9 of what it was.

    With step size 1 the resolvent of df at s is psi(s / g), psi(z) = phi(z) - l z: the graph of the unit is all it takes.
    """
    (low, high), split = slopes(inc.activations), prepare(inc.W, inc.activations, T, alpha=1.0)
    gain = high - low
    inverse_gain = np.divide(1.0, gain, out=np.zeros_like(gain), where=gain > 0)
    w, r = ca.MX.sym("w", inc.q), ca.MX.sym("r", inc.q)
    drive = ca.DM(split.drive) @ r
    reflected = 2 * (ca.DM(split.inverse) @ (w + drive)) - w
    v = _psi(inc.activations, reflected * ca.DM(inverse_gain), low, smoothing)
    step = ca.Function("step", [w, r], [2 * v - reflected])
    steps = min(_LONGEST_GUESS, int(np.log(_GUESS) / np.log(max(split.rate, 1e-3))) + 1)
    first = _psi(inc.activations, r, low, smoothing)
    last = step.fold(steps)(first + ca.DM(split.F) @ first - drive, ca.repmat(r, 1, steps))
    eta = ca.DM(split.back) @ (ca.DM(split.inverse) @ (last + drive) + ca.DM(low) * r)
    return ca.Function("guess", [r], [eta], ["r"], ["eta"])


def _psi(units: Units, z: Any, low: Array, smoothing: float) -> Any:
    return units_graph(units, z, smoothing) - ca.DM(low) * z


def _one_pass(units: Units, W: Array, r: Any, levels: list[np.ndarray], smoothing: float) -> Any:
    """Solve a feedforward fixed point level by level; each level reads only the levels before it."""
    done, eta = np.zeros(0, dtype=int), type(r)(0, 1)
    for level in levels:
        z = r[level.tolist()] + ca.sparsify(ca.DM(W[np.ix_(level, done)])) @ eta
        eta = ca.vertcat(eta, units_graph(tuple(units[i] for i in level), z, smoothing))
        done = np.concatenate([done, level])
    return eta[np.argsort(done).tolist()] if done.size else eta


def units_graph(units: Units, z: Any, smoothing: float) -> Any:
    """Return phi(z) for one activation per entry of the column z, kinks rounded as in `activation_graph`.

    >>> from inc_casadi.activations import ReLU, Tanh
    >>> units_graph((ReLU(), Tanh(), ReLU()), ca.DM([-1.0, 0.0, 2.0]), 0.0).full().ravel().tolist()
    [0.0, 0.0, 2.0]
    """
    if len(set(units)) <= 1:
        return activation_graph(units[0], z, smoothing) if units else z
    parts = [(rows, activation_graph(unit, z[rows.tolist()], smoothing)) for unit, rows in groups(units)]
    order = np.argsort(np.concatenate([rows for rows, _ in parts]))
    return ca.vertcat(*[part for _, part in parts])[order.tolist()]
