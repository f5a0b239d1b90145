"""An equilibrium of a loop with curved units: proved to exist in a small box, by Krawczyk's operator with slopes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..activations.stack import Units, derivative, evaluate, groups, slopes_on
from ..arrays import Array
from ..blocks import hstack, vstack
from ..errors import ConvergenceError, NoEquilibriumError, NotWellPosedError
from ..loop import ClosedLoop, equilibrium
from ..readings import EPS, Rounded
from .rest import Rest
from .unit_bounds import beside

POLISHING, ROUNDS = 3, 12
START, WIDEN = 1e-15, 2.0  # of the box's half widths: relative to 1 + |y| at first, and beyond what was asked later


def enclosed_rest(loop: ClosedLoop) -> Rest | None:
    """Return bounds between which the loop has an equilibrium, and no other, or None when none was proved.

    With y = (x, z) an equilibrium is a zero of g(y) = (A x + B (K C x + V phi(z) + d) - x, W phi(z) + U C x + b - z)
    (no "- x" in continuous time). Between any two points of a box, g(y) - g(y') = S (y - y') for some
    S = [A + B K C - I, B V D; U C, W D - I] with D diagonal between the units' slopes on the box. For y' = y^ near the zero
    and any matrix Y, K(y) = y - Y g(y) then has

        |K(y) - y^| <= |Y g(y^)| + |I - Y S| |y - y^|.

    Where the right side is below the half widths d of the box around y^, for |y - y^| <= d and all such D, K maps the box
    into itself, so it has a fixed point (Brouwer); |I - Y S| d < d makes Y and S nonsingular, so the point is a zero of g,
    and the only one in the box. Every rounding is bounded. Nothing is asked of the units but values and slopes on intervals.

    >>> from inc_casadi import INC, Plant, Tanh, close_loop
    >>> loop = close_loop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[-1.0]], [[1.0]], [[0.0]], b=[1.0], activation=Tanh()))
    >>> rest = enclosed_rest(loop)
    >>> x = float(rest.x_low[0])
    >>> bool(abs(x - 2 * np.tanh(1 - x)) < 1e-13), float(rest.x_high[0]) - x < 1e-13
    (True, True)
    """
    try:
        at = equilibrium(loop.plant, loop.inc)
    except (NoEquilibriumError, ConvergenceError, NotWellPosedError):
        return None
    y = np.concatenate([at.x, at.z])
    try:
        for _ in range(POLISHING):
            Y, g, _ = _newton(loop, y)
            y = y - Y @ g
        half = _half_widths(loop, y)
    except np.linalg.LinAlgError:
        return None
    if half is None:
        return None
    n = loop.n
    x, z = y[:n], y[n:]
    u, slack = _input(loop, x, z, half)
    return Rest(*_around(x, half[:n]), *_around(z, half[n:]), *_around(u, slack))


def _newton(loop: ClosedLoop, y: Array) -> tuple[Array, Array, Array]:
    """Return Y, the inverse of S at y in floats, and g(y) with a bound on its error."""
    n, inc = loop.n, loop.inc
    outer, columns = _linear_part(loop)
    slope = derivative(inc.activations, y[n:, None])[:, 0]
    S = outer.value + np.hstack([np.zeros((len(y), n)), columns.value * slope])
    return np.linalg.inv(S), *_residual(loop, outer, columns, y)


def _half_widths(loop: ClosedLoop, y: Array) -> Array | None:
    """Return d (n + q,) for which Krawczyk's condition holds around y, or None."""
    Y, residual, error = _newton(loop, y)
    first = _above_product(np.abs(Y), np.abs(residual) + error)
    half = START * (1 + np.abs(y)) + WIDEN * first
    for _ in range(ROUNDS):
        asked = first + _above_product(_departure(loop, Y, y[loop.n:], half[loop.n:]), half)
        asked = asked * (1 + 8 * EPS) + np.finfo(float).tiny
        if np.all(asked < half):
            return half
        if not np.all(np.isfinite(asked)):
            return None
        half = np.maximum(half, WIDEN * asked)
    return None


def _linear_part(loop: ClosedLoop) -> tuple[Rounded, Rounded]:
    """Return the parts of S without D, (n + q, n + q), and the columns [B V; W] that D multiplies, (n + q, q)."""
    plant, inc = loop.plant, loop.inc
    n, q = loop.n, loop.q
    C, B = Rounded.lift(plant.C), Rounded.lift(plant.B)
    shift = np.eye(n) if plant.discrete else np.zeros((n, n))
    on_x = vstack(Rounded.lift(plant.A) + B @ inc.K @ C - shift, Rounded.lift(inc.U) @ C)
    on_z = Rounded.lift(np.vstack([np.zeros((n, q)), -np.eye(q)]))
    return hstack(on_x, on_z), vstack(B @ inc.V, Rounded.lift(inc.W))


def _residual(loop: ClosedLoop, outer: Rounded, columns: Rounded, y: Array) -> tuple[Array, Array]:
    """Return g(y) as computed and a bound on its error."""
    inc, n = loop.inc, loop.n
    eta, error = _values(inc.activations, y[n:])
    constant = vstack(Rounded.lift(loop.plant.B) @ inc.d[:, None], Rounded.lift(inc.b[:, None]))
    g = outer @ y[:, None] + columns @ eta[:, None] + constant
    size = np.abs(columns.value) + columns.error
    return g.value[:, 0], g.error[:, 0] + _above_product(size, error)


def _values(units: Units, z: Array) -> tuple[Array, Array]:
    """Return phi(z) as computed and a bound on its error."""
    eta, error = evaluate(units, z[:, None])[:, 0], np.empty_like(z)
    for unit, rows in groups(units):
        below, above = beside(unit, np.zeros(len(rows)), z[rows], z[rows])
        error[rows] = np.maximum(above - eta[rows], eta[rows] - below) * (1 + 2 * EPS)
    return eta, error


def _departure(loop: ClosedLoop, Y: Array, center: Array, half: Array) -> Array:
    """Return an upper bound on |I - Y S| over all D between the slopes on |z - center| <= half."""
    units, n = loop.inc.activations, loop.n
    outer, columns = _linear_part(loop)
    reach = half * (1 + 2 * EPS)
    low, high = np.nextafter(center - reach, -np.inf), np.nextafter(center + reach, np.inf)
    lower, upper = slopes_on(units, low, high)
    middle = (lower + upper) / 2
    spread = np.maximum(upper - middle, middle - lower) * (1 + 2 * EPS)
    S = outer + hstack(Rounded.lift(np.zeros((len(Y), n))), columns * middle)
    gap = Y @ S - np.eye(len(Y))
    through = Y @ columns
    varied = (np.abs(through.value) + through.error) * spread
    return (np.abs(gap.value) + gap.error + np.hstack([np.zeros((len(Y), n)), varied])) * (1 + 8 * EPS)


def _above_product(M: Array, v: Array) -> Array:
    """Return an upper bound on M v for M, v >= 0."""
    return (M @ v) * (1 + 4 * (M.shape[1] + 8) * EPS) + np.finfo(float).tiny * (M.shape[1] + 1)


def _input(loop: ClosedLoop, x: Array, z: Array, half: Array) -> tuple[Array, Array]:
    """Return u = K C x + V phi(z) + d as computed, and a bound on its distance from that of the equilibrium."""
    inc, n = loop.inc, loop.n
    eta, error = _values(inc.activations, z)
    KC = Rounded.lift(inc.K) @ loop.plant.C
    u = KC @ x[:, None] + Rounded.lift(inc.V) @ eta[:, None] + inc.d[:, None]
    steep = np.max(np.abs([unit.slopes for unit in inc.activations]).reshape(-1, 2), axis=1, initial=0.0)
    moved = error + steep * half[n:] * (1 + 4 * EPS)
    slack = u.error[:, 0] + _above_product(np.abs(KC.value) + KC.error, half[:n]) + _above_product(np.abs(inc.V), moved)
    return u.value[:, 0], slack * (1 + 8 * EPS)


def _around(middle: Array, half: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return middle - half and middle + half in Fractions."""
    pairs = [(Fraction(float(a)) - Fraction(float(w)), Fraction(float(a)) + Fraction(float(w)))
             for a, w in zip(middle, half, strict=True)]
    low, high = np.empty(len(pairs), dtype=object), np.empty(len(pairs), dtype=object)
    low[:], high[:] = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    return low, high
