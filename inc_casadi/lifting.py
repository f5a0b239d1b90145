"""Several steps of a loop in one stack, so that a Lyapunov function may be quadratic in x and in hidden vectors to come."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .blocks import hstack, vstack
from .errors import InvalidInputError
from .loop import ClosedLoop


def unrolled(loop: ClosedLoop, steps: int, *, next_too: bool) -> ClosedLoop:
    """Return the loop over s = (x, eta_0, w, eta_1, ...), where V is quadratic in (x, eta_0, ..., eta_{steps-1}).

    With x_0 = x, x_{k+1} = F (x_k, eta_k) and eta_k = phi(z_k), z_k = Z (x_k, eta_k), everything is a function of x, so
    V(x) = v'P v, v = (x, eta_0, ..., eta_{steps-1}), is a function of the state: one that is quadratic on each of the
    regions in which the hidden vectors are affine. One step on, v becomes (x_1, eta_1, ..., eta_steps): the rows F of the
    result, where X are the rows of v, and Z, H those of all z_k and eta_k. next_too: whether eta_steps is in the stack;
    without it the stack is v itself, and F has no rows.

    Columns w that enter from outside belong to the first step; then steps must be 1, for x_2 would depend on the
    next w, and w must not reach the measurement, for V would depend on it.

    Raises InvalidInputError in continuous time (hidden vectors have no derivative at kinks) and for such w.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[2.0]], [[1.0]], [[0.0]]))
    >>> lifted = unrolled(loop, 1, next_too=True)
    >>> lifted.F.tolist(), lifted.Z.tolist()
    ([[0.5, 1.0, 0.0], [0.0, 0.0, 1.0]], [[2.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    """
    obstacle = lifting_obstacle(loop, steps)
    if obstacle:
        raise InvalidInputError(obstacle)
    n, q, last = loop.n, loop.q, steps + (1 if next_too else 0)
    if not next_too:
        loop = _without_inputs(loop)
    extra = (last - 1) * q
    width = loop.width + extra
    rows = np.eye(width)
    eta = [rows[n: n + q], *(rows[loop.width + k * q: loop.width + (k + 1) * q] for k in range(last - 1))]
    x: list[Any] = [rows[:n]]
    z = [loop.padded(loop.Z, extra)]
    for k in range(1, last):
        step = loop.padded(loop.F, extra) if k == 1 else loop.F[:, :n] @ x[-1] + loop.F[:, n: n + q] @ eta[k - 1]
        x.append(step)
        z.append(loop.Z[:, :n] @ step + loop.Z[:, n: n + q] @ eta[k])
    ahead = vstack(x[1], *eta[1: steps + 1]) if next_too else loop.padded(loop.F[:0], extra)
    lower, upper = hstack(*[loop.lower] * last), hstack(*[loop.upper] * last)
    return replace(loop, F=ahead, G=loop.padded(loop.G, extra), Z=vstack(*z), X=vstack(x[0], *eta[:steps]),
                   H=np.vstack(eta), lower=lower, upper=upper, units=loop.units * last)


def lifting_obstacle(loop: ClosedLoop, steps: int) -> str | None:
    """Return why V cannot depend on the hidden vectors of that many steps, or None."""
    if not loop.plant.discrete:
        return ("a Lyapunov function of (x, eta) needs discrete time: in continuous time eta has no derivative where a "
                "unit has a kink")
    if loop.about == "difference":
        return ("a Lyapunov function of (x, eta) needs an equilibrium about which the units stay the same from step to "
                "step, but for a biased loop s is the difference of two motions")
    outside = loop.inputs
    if outside and steps > 1:
        return f"with inputs from outside a Lyapunov function may look one step ahead only, not {steps}"
    reaches = loop.Z[:, loop.n + loop.q:]
    if outside and np.any(getattr(reaches, "value", getattr(reaches, "numbers", reaches)) != 0):
        return "a Lyapunov function of (x, eta) is none of the state when the measurement is disturbed"
    return None


def _without_inputs(loop: ClosedLoop) -> ClosedLoop:
    columns = slice(0, loop.n + loop.q)
    return replace(loop, inputs=0, F=loop.F[:, columns], G=loop.G[:, columns], Z=loop.Z[:, columns], X=loop.X[:, columns],
                   H=loop.H[:, columns])
