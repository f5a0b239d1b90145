"""The C functions of a loop that contracts: by contraction steps, or by Newton's trials with those as a safeguard."""

from __future__ import annotations

from ...activations.stack import Units
from ...arrays import Array
from .expressions import number
from .loops import Loop
from .text import add_product, applied, constants, counters, function, may_vanish, tangents

DISTANCE = """\
static double distance(int n, const double *a, const double *b, const double *per)
{
    double most = 0.0, sum = 0.0;
    int i;
    for (i = 0; i < n; i++) {
        const double gap = a[i] - b[i], far = (gap < 0.0 ? -gap : gap) * per[i];
        most = far > most ? far : most;
        sum += far;
    }
    return sum - sum == 0.0 ? most : sum;  /* a NaN or an infinity is never lost */
}
""".splitlines()

SUBTRACT = """\
static void subtract(int n, double factor, const double *restrict a, double *restrict b)
{
    int i;
    for (i = 0; i < n; i++) b[i] -= factor * a[i];
}
""".splitlines()

DOT = """\
static double dot(int n, const double *restrict a, const double *restrict b)
{
    double s0 = 0.0, s1 = 0.0, s2 = 0.0, s3 = 0.0;
    int i;
    for (i = 0; i + 4 <= n; i += 4) {
        s0 += a[i] * b[i];
        s1 += a[i + 1] * b[i + 1];
        s2 += a[i + 2] * b[i + 2];
        s3 += a[i + 3] * b[i + 3];
    }
    for (; i < n; i++) s0 += a[i] * b[i];
    return (s0 + s1) + (s2 + s3);
}
""".splitlines()


def preactivation(k: int, W: Array, units: Units) -> list[str]:
    """Return the function z = c + W eta of loop k, and its matrix."""
    n = len(units)
    body = [f"for (i = 0; i < {n}; i++) z[i] = c[i];", *add_product(f"loop_{k}", W, "eta", "z", may_vanish(units))]
    head = f"static void preactivation_{k}(const double *restrict c, const double *restrict eta, double *restrict z)"
    return [*constants(f"loop_{k}", W), "", *function(head, counters(body), body)]


def weights(k: int, loop: Loop) -> list[str]:
    """Return the reciprocals of the weights of the norm of loop k."""
    return constants(f"per_{k}", 1.0 / loop.weights)


def contraction(k: int, units: Units, loop: Loop, tol: float) -> list[str]:
    """Return the function that solves loop k by contraction steps and returns how often phi was evaluated."""
    n = len(units)
    body = [*applied(units, "c", "eta"), *_scale(k, n), f"tau = {number(tol)} * (scale > 1.0 ? scale : 1.0);",
            f"for (k = 1; k < {loop.steps} && open; k++) {{", f"    preactivation_{k}(c, eta, z);",
            *(f"    {line}" for line in applied(units, "z", "next")), "    open = 0;", f"    for (i = 0; i < {n}; i++) {{",
            f"        const double gap = next[i] - eta[i], far = (gap < 0.0 ? -gap : gap) * per_{k}[i];",
            "        open |= !(far <= tau);", "        eta[i] = next[i];", "    }", "}", "return k;"]
    return function(f"static int solve_{k}(const double *restrict c, double *restrict eta)",
                    [f"double z[{n}], next[{n}], scale = 0.0, tau;", "int i, k, open = 1;"], body)


def _scale(k: int, n: int) -> list[str]:
    return [f"for (i = 0; i < {n}; i++) {{", f"    const double far = (eta[i] < 0.0 ? -eta[i] : eta[i]) * per_{k}[i];",
            "    scale = far > scale ? far : scale;", "}"]


def pattern_fields(k: int, n: int) -> list[str]:
    """Return the fields that hold the last pattern of loop k: tangents, units with a slope, the factors of I - D W there."""
    return [f"double rise_{k}[{n}], offset_{k}[{n}], factors_{k}[{n * n}];", f"int active_{k}[{n}], count_{k};"]


def pattern_solution(k: int, units: Units, cache: bool) -> list[str]:
    """Return the functions that factor I - D W on the units with a nonzero slope, and solve eta = D (W eta + c) + offset.

    Where the loop contracts, I - D W is diagonally dominant by rows once its columns are scaled by the weights, so
    elimination needs no pivots; the residual of what it finds is looked at in any case. With a cache the inverse is
    formed, column by column, at three times the cost: a pattern is then solved by one product.
    """
    n = len(units)
    at = f"a[j * {n} + i]" if cache else f"a[i * {n} + j]"
    factor = [f"for (i = 0; i < {n}; i++) if (s->rise_{k}[i] != 0.0) s->active_{k}[count++] = i;", f"s->count_{k} = count;",
              "for (i = 0; i < count; i++) {", f"    const double rise = s->rise_{k}[s->active_{k}[i]];",
              "    for (j = 0; j < count; j++)",
              f"        {at} = (i == j ? 1.0 : 0.0) - rise * loop_{k}[s->active_{k}[j] * {n} + s->active_{k}[i]];", "}",
              *(_inversion(n) if cache else _elimination(n))]
    solve = [f"for (i = 0; i < {n}; i++) {{", f"    eta[i] = s->rise_{k}[i] == 0.0 ? s->offset_{k}[i] : 0.0;",
             "    fixed |= eta[i] != 0.0;", "}", f"if (fixed) preactivation_{k}(c, eta, z);",
             f"else for (i = 0; i < {n}; i++) z[i] = c[i];", *(_product(k, n) if cache else _substitution(k, n)),
             f"for (i = 0; i < count; i++) eta[s->active_{k}[i]] = x[i];"]
    return [*function(f"static void factor_{k}(pattern *restrict s)",
                      [f"double *a = s->factors_{k};", "int i, j, k, count = 0;"], factor),
            *function(f"static void solve_pattern_{k}(const pattern *s, const double *restrict c, double *restrict eta)",
                      [f"const double *a = s->factors_{k};", f"double x[{n}], z[{n}];",
                       f"const int count = s->count_{k};", f"int i, {'j, ' if cache else ''}fixed = 0;"], solve)]


def _elimination(n: int) -> list[str]:
    return ["for (k = 0; k < count; k++) {", f"    const double pivot = 1.0 / a[k * {n} + k];",
            f"    a[k * {n} + k] = pivot;", "    for (i = k + 1; i < count; i++) {",
            f"        const double factor = a[i * {n} + k] * pivot;",
            f"        a[i * {n} + k] = factor;",
            f"        subtract(count - k - 1, factor, a + k * {n} + k + 1, a + i * {n} + k + 1);", "    }", "}"]


def _substitution(k: int, n: int) -> list[str]:
    return ["for (i = 0; i < count; i++) {", f"    const int unit = s->active_{k}[i];",
            f"    x[i] = s->rise_{k}[unit] * z[unit] + s->offset_{k}[unit];", f"    x[i] -= dot(i, a + i * {n}, x);", "}",
            "for (i = count - 1; i >= 0; i--)",
            f"    x[i] = (x[i] - dot(count - i - 1, a + i * {n} + i + 1, x + i + 1)) * a[i * {n} + i];"]


def _inversion(n: int) -> list[str]:
    """Gauss-Jordan steps on the transpose, in place."""
    return ["for (k = 0; k < count; k++) {", f"    const double pivot = 1.0 / a[k * {n} + k];",
            f"    a[k * {n} + k] = 1.0;", f"    for (j = 0; j < count; j++) a[k * {n} + j] *= pivot;",
            "    for (i = 0; i < count; i++) {",
            f"        const double factor = a[i * {n} + k];", "        if (i == k) continue;",
            f"        a[i * {n} + k] = 0.0;", f"        subtract(count, factor, a + k * {n}, a + i * {n});", "    }", "}"]


def _product(k: int, n: int) -> list[str]:
    """x = inverse right-hand side, four columns at a time."""
    return ["for (i = 0; i < count; i++) {", "    x[i] = 0.0;",
            f"    eta[i] = s->rise_{k}[s->active_{k}[i]] * z[s->active_{k}[i]] + s->offset_{k}[s->active_{k}[i]];", "}",
            "for (j = 0; j + 4 <= count; j += 4) {", f"    const double *restrict column = a + j * {n};",
            "    const double t0 = eta[j], t1 = eta[j + 1], t2 = eta[j + 2], t3 = eta[j + 3];",
            "    for (i = 0; i < count; i++)", f"        x[i] += column[i] * t0 + column[i + {n}] * t1"
            f" + column[i + {2 * n}] * t2 + column[i + {3 * n}] * t3;", "}",
            f"for (; j < count; j++) for (i = 0; i < count; i++) x[i] += a[j * {n} + i] * eta[j];",
            f"for (i = 0; i < {n}; i++) eta[i] = s->rise_{k}[i] == 0.0 ? s->offset_{k}[i] : 0.0;"]


def newton(k: int, units: Units, loop: Loop, tol: float, cache: bool) -> list[str]:
    """Return the function that solves loop k by Newton's trials, each taken only if it shrinks the residual by the rate.

    With a cache the last pattern is tried first; where it is still the pattern at the solution, that is all.
    """
    n, rate = len(units), number(loop.rate)
    begin = [*applied(units, "c", "eta"), *_scale(k, n), f"tau = {number(tol)} * (scale > 1.0 ? scale : 1.0);"]
    cached = ["if (s->filled) {", f"    solve_pattern_{k}(s, c, trial);", f"    preactivation_{k}(c, trial, z);",
              *(f"    {line}" for line in applied(units, "z", "image")), f"    gap = distance({n}, image, trial, per_{k});",
              "    k = 1;", "}", "if (!(gap <= scale)) {"]
    fresh = [f"preactivation_{k}(c, eta, z);", *applied(units, "z", "image"), f"gap = distance({n}, image, eta, per_{k});",
             "k += 2;"]
    trial = [f"for (tried = 0; tried < {loop.trials} && gap > tau; tried++) {{",
             *(f"    {line}" for line in tangents(units, "z", "image", f"s->rise_{k}", f"s->offset_{k}")),
             f"    factor_{k}(s);", f"    solve_pattern_{k}(s, c, trial);", f"    preactivation_{k}(c, trial, ahead);",
             *(f"    {line}" for line in applied(units, "ahead", "eta")), f"    next = distance({n}, eta, trial, per_{k});",
             "    k++;",
             f"    if (next <= {rate} * gap) {{",
             f"        for (i = 0; i < {n}; i++) {{ z[i] = ahead[i]; image[i] = eta[i]; }}",
             "        gap = next;", "    } else {",
             *(f"        {line}" for line in _step(k, units)), "    }", "}"]
    last = [f"for (tried = 0; tried < {loop.steps} && gap > tau; tried++) {{",
            *(f"    {line}" for line in _step(k, units)), "}",
            f"for (i = 0; i < {n}; i++) eta[i] = image[i];", "return k;"]
    body = [*begin, *([*cached, *(f"    {line}" for line in fresh), "}"] if cache else fresh), *trial, *last]
    return function(f"static int solve_{k}(pattern *restrict s, const double *restrict c, double *restrict eta)",
                    [f"double z[{n}], image[{n}], trial[{n}], ahead[{n}], scale = 0.0, tau, gap = 1e300, next;",
                     "int i, k = 0, tried;"], body)


def _step(k: int, units: Units) -> list[str]:
    n = len(units)
    return [f"for (i = 0; i < {n}; i++) trial[i] = image[i];", f"preactivation_{k}(c, trial, z);",
            *applied(units, "z", "image"), f"gap = distance({n}, image, trial, per_{k});", "k++;"]
