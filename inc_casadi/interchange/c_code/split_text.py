"""The C functions of a loop that only a multiplier proves: Newton's trials, then splitting, judged by the residual."""

from __future__ import annotations

import numpy as np

from ...activations import Activation
from ...activations.stack import Units
from ...splitting import Splitting
from .expressions import curve, line, number, value
from .loops import Loop
from .pattern_text import own_pattern
from .split_loops import BETWEEN
from .text import add_product, applied, constants, counters, function, runs, tangents


def matrices(k: int, loop: Loop) -> list[str]:
    """Return the constant matrices of the splitting of loop k.

    With J(w) = 2 (I + alpha F)^{-1} (w + alpha g) - w and g = drive c, J(w) = reflect w + shift c.
    """
    reflect, shift = _operators(loop)
    out = [*(constants(f"reflect_{k}", reflect) if reflect.any() else []), *constants(f"shift_{k}", shift)]
    assert loop.splitting is not None
    if loop.splitting.low.any():
        out += [*constants(f"back_{k}", loop.splitting.back), *constants(f"low_{k}", loop.splitting.low)]
    return out


def _operators(loop: Loop) -> tuple[np.ndarray, np.ndarray]:
    operators = loop.splitting
    assert operators is not None
    return 2 * operators.inverse - np.eye(len(operators.low)), 2 * operators.alpha * operators.inverse @ operators.drive


def resolvent(unit: Activation, alpha: float, r: str) -> str:
    """Return (I + alpha df)^{-1}(r) in C, the psi(z) of `splitting.resolvent`; with a curved unit alpha has to be 1.

    >>> from inc_casadi import ReLU, Tanh
    >>> resolvent(ReLU(), 0.5, "r"), resolvent(Tanh(), 1.0, "r")
    ('r < 0.0 ? 0.0 : r', 'tanh(1.0 * r)')
    """
    low, high = unit.slopes
    if low == high:
        return number(float(unit(0.0)))
    gain = high - low
    if curve(unit) is not None:
        z = f"{number(1.0 / gain)} * {r}"
        formula = value(unit, f"({z})").replace(f"tanh(({z}))", f"tanh({z})")
        return formula if low == 0.0 else f"({formula}) + {number(-low)} * {z}"
    pieces = unit.pieces
    assert pieces is not None
    psi = pieces.slopes - low
    steep, offset = (1.0 - alpha) * psi + alpha * gain, (1.0 - alpha) * pieces.intercepts
    kinks = steep[:-1] * pieces.kinks + offset[:-1]
    parts = [line(r, s / h, c - s / h * o) for s, h, o, c in zip(psi, steep, offset, pieces.intercepts, strict=True)]
    return "".join(f"{r} < {number(kink)} ? {part} : " for kink, part in zip(kinks, parts, strict=False)) + parts[-1]


def splitting(k: int, units: Units, loop: Loop, tol: float, cache: bool) -> list[str]:
    """Return the function that solves loop k: how many steps it took, negative when the residual never passed its test.

    With trials one more starts from where the splitting is after 8, 16, 32, ... steps; it can end the work and not
    disturb it.
    """
    n, operators = len(units), loop.splitting
    assert operators is not None
    reflect, shift = _operators(loop)
    keeps = reflect.any()  # else each step gives the same
    begin = [f"for (i = 0; i < {n}; i++) {{", "    const double far = c[i] < 0.0 ? -c[i] : c[i];",
             "    scale = far > scale ? far : scale;", "}", f"tau = {number(tol)} * (scale > 1.0 ? scale : 1.0);"]
    body = [f"for (i = 0; i < {n}; i++) {{ shift[i] = 0.0;{' w[i] = 0.0;' if keeps else ''} }}",
            *add_product(f"shift_{k}", shift, "c", "shift"),
            f"for (k = 1; k <= {loop.steps}; k++) {{", f"    for (i = 0; i < {n}; i++) r[i] = shift[i];",
            *(f"    {text}" for text in add_product(f"reflect_{k}", reflect, "w", "r")),
            *(f"    for (i = {a}; i < {b}; i++) v[i] = {resolvent(units[at], operators.alpha, 'r[i]')};"
              for a, b, at in runs(units)),
            *([f"    for (i = 0; i < {n}; i++) w[i] = 2.0 * v[i] - r[i];"] if keeps else []),
            f"    if (k % {BETWEEN} != 0) continue;",
            *(f"    {text}" for text in _back(k, operators)),
            f"    if (residual_{k}(c, eta, z, image) <= tau) return tried + k;",
            *(_another(k, units) if loop.trials else []), "}", f"return -(tried + {loop.steps});"]
    newton = _trials(k, units, loop, cache) if loop.trials else []
    head, own = own_pattern(k, cache) if loop.trials else ("", [])
    more = (", gap = 1e300" if cache else ", gap") if newton else ""
    sizes = f"double z[{n}], image[{n}],{f' w[{n}],' if keeps else ''} r[{n}], v[{n}], shift[{n}], scale = 0.0, tau{more};"
    whole = [*begin, *newton, *body]
    return [*_residual(k, units), *function(f"static int solve_{k}({head}const double *restrict c, double *restrict eta)",
                                           [sizes, *own, *counters(whole), "int tried = 0;"], whole)]


def _residual(k: int, units: Units) -> list[str]:
    n = len(units)
    body = [f"preactivation_{k}(c, eta, z);", *applied(units, "z", "image"), f"return distance({n}, image, eta, per_{k});"]
    return function(f"static double residual_{k}(const double *restrict c, const double *restrict eta, double *restrict z, "
                    "double *restrict image)", ["int i;"], body)


def _back(k: int, operators: Splitting) -> list[str]:
    n = len(operators.low)
    if not operators.low.any():
        return [f"for (i = 0; i < {n}; i++) eta[i] = v[i];"]
    return [f"for (i = 0; i < {n}; i++) {{ r[i] = v[i] + low_{k}[i] * c[i]; eta[i] = 0.0; }}",
            *add_product(f"back_{k}", operators.back, "r", "eta")]


def _another(k: int, units: Units) -> list[str]:
    return ["    if (k & (k - 1)) continue;", *(f"    {text}" for text in _trial(k, units)),
            f"    if (residual_{k}(c, eta, z, image) <= tau) return tried + k;"]


def _trial(k: int, units: Units) -> list[str]:
    return [*tangents(units, "z", "image", f"s->rise_{k}", f"s->offset_{k}"), f"factor_{k}(s);",
            f"solve_pattern_{k}(s, c, eta);"]


def _trials(k: int, units: Units, loop: Loop, cache: bool) -> list[str]:
    """Newton's steps from phi(c), or from the last pattern, each taken as it comes; passing the test ends the work."""
    cached = ["if (s->filled) {", f"    solve_pattern_{k}(s, c, eta);", f"    gap = residual_{k}(c, eta, z, image);",
              "    tried = 1;", "}", "if (!(gap <= scale)) {"] if cache else []
    fresh = [*applied(units, "c", "eta"), f"gap = residual_{k}(c, eta, z, image);"]
    return [*cached, *([*(f"    {text}" for text in fresh), "}"] if cache else fresh),
            f"for (; tried < {loop.trials} && gap > tau; tried++) {{",
            *(f"    {text}" for text in _trial(k, units)), f"    gap = residual_{k}(c, eta, z, image);", "}",
            "if (gap <= tau) return tried;"]
