"""The C functions of a loop that contracts: by contraction steps, or by Newton's trials with those as a safeguard."""

from __future__ import annotations

from ...activations.stack import Units
from ...arrays import Array
from .expressions import number
from .loops import Loop
from .pattern_text import own_pattern, solved
from .text import add_product, applied, constants, counters, function, may_vanish, tangents

DISTANCE = """\
static double distance(int n, const double *restrict a, const double *restrict b, const double *restrict per)
{
    double m0 = 0.0, m1 = 0.0, m2 = 0.0, m3 = 0.0, s0 = 0.0, s1 = 0.0, s2 = 0.0, s3 = 0.0;
    int i;
    for (i = 0; i + 4 <= n; i += 4) {
        const double g0 = a[i] - b[i], g1 = a[i + 1] - b[i + 1], g2 = a[i + 2] - b[i + 2], g3 = a[i + 3] - b[i + 3];
        const double f0 = (g0 > -g0 ? g0 : -g0) * per[i], f1 = (g1 > -g1 ? g1 : -g1) * per[i + 1];
        const double f2 = (g2 > -g2 ? g2 : -g2) * per[i + 2], f3 = (g3 > -g3 ? g3 : -g3) * per[i + 3];
        m0 = f0 > m0 ? f0 : m0;
        m1 = f1 > m1 ? f1 : m1;
        m2 = f2 > m2 ? f2 : m2;
        m3 = f3 > m3 ? f3 : m3;
        s0 += f0;
        s1 += f1;
        s2 += f2;
        s3 += f3;
    }
    for (; i < n; i++) {
        const double gap = a[i] - b[i], far = (gap > -gap ? gap : -gap) * per[i];
        m0 = far > m0 ? far : m0;
        s0 += far;
    }
    m0 = m0 > m1 ? m0 : m1;
    m2 = m2 > m3 ? m2 : m3;
    s0 = (s0 + s1) + (s2 + s3);
    return s0 - s0 == 0.0 ? (m0 > m2 ? m0 : m2) : s0;  /* a NaN or an infinity is never lost */
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
    """Return the function that solves loop k by contraction steps and returns how often phi was evaluated.

    Two steps go to each test, from eta to next and back, so nothing is copied and half of the tests are saved.
    """
    n = len(units)
    body = [*applied(units, "c", "eta"), f"scale = distance({n}, eta, origin_{k}, per_{k});",
            f"tau = {number(tol)} * (scale > 1.0 ? scale : 1.0);",
            f"for (k = 1; k < {loop.steps} && open; k += 2) {{", f"    preactivation_{k}(c, eta, z);",
            *(f"    {line}" for line in applied(units, "z", "next")), f"    preactivation_{k}(c, next, z);",
            *(f"    {line}" for line in applied(units, "z", "eta")),
            f"    open = !(distance({n}, eta, next, per_{k}) <= tau);", "}", "return k;"]
    return [*origin(k, n), *function(f"static int solve_{k}(const double *restrict c, double *restrict eta)",
                                     [f"double z[{n}], next[{n}], scale, tau;", "int i, k, open = 1;"], body)]


def origin(k: int, n: int) -> list[str]:
    """Return the definition of the zero vector of loop k."""
    return [f"static const double origin_{k}[{n}] = {{0.0}};", ""]


def newton(k: int, units: Units, loop: Loop, tol: float, cache: bool) -> list[str]:
    """Return the function that solves loop k by Newton's trials, each taken only if it shrinks the residual by the rate.

    With a cache the last pattern is tried first; where it is still the pattern at the solution, that is all.
    """
    n, rate, start = len(units), number(loop.rate), " = 1e300" if cache else ""
    begin = [*applied(units, "c", "eta"), f"scale = distance({n}, eta, origin_{k}, per_{k});",
             f"tau = {number(tol)} * (scale > 1.0 ? scale : 1.0);"]
    cached = ["if (s->filled) {", f"    solve_pattern_{k}(s, c, trial);",
              f"    preactivation_{k}(c, trial, z);",
              *(f"    {line}" for line in applied(units, "z", "image")), f"    gap = distance({n}, image, trial, per_{k});",
              "    k = 1;", "}", "if (!(gap <= scale)) {"]
    fresh = [f"preactivation_{k}(c, eta, z);", *applied(units, "z", "image"), f"gap = distance({n}, image, eta, per_{k});",
             "k += 2;"]
    trial = [f"for (tried = 0; tried < {loop.trials} && gap > tau; tried++) {{",
             *(f"    {line}" for line in tangents(units, "z", "image", f"s->rise_{k}", f"s->offset_{k}")),
             *(f"    {line}" for line in solved(k, n, loop, "trial", "image")), f"    preactivation_{k}(c, trial, ahead);",
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
    head, own = own_pattern(k, cache)
    return [*origin(k, n),
            *function(f"static int solve_{k}({head}const double *restrict c, double *restrict eta)",
                      [f"double z[{n}], image[{n}], trial[{n}], ahead[{n}], scale, tau, gap{start}, next;",
                       *own, "int i, k = 0, tried;"], body)]


def _step(k: int, units: Units) -> list[str]:
    n = len(units)
    return [f"for (i = 0; i < {n}; i++) trial[i] = image[i];", f"preactivation_{k}(c, trial, z);",
            *applied(units, "z", "image"), f"gap = distance({n}, image, trial, per_{k});", "k++;"]
