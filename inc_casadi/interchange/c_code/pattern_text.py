"""The C of a pattern of slopes: its equation solved by elimination, by a kept inverse, or by steps on few units."""

from __future__ import annotations

from ...activations.stack import Units
from .loops import Loop
from .text import function, padded

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


def pattern_type(k: int, cache: bool) -> str:
    """Return the type of the pattern of loop k: the state of all loops with a cache, else its own."""
    return "pattern" if cache else f"pattern_{k}"


def own_pattern(k: int, cache: bool) -> tuple[str, list[str]]:
    """Return the argument that hands the pattern to the function that solves loop k, or else its declaration there."""
    if cache:
        return "pattern *restrict s, ", []
    return "", [f"{pattern_type(k, cache)} own, *const s = &own;"]


def pattern_fields(k: int, n: int, loop: Loop) -> list[str]:
    """Return the fields of a pattern of loop k: tangents and, without inner steps, units with a slope and their factors."""
    if loop.inner:
        return [f"double rise_{k}[{n}], offset_{k}[{n}];"]
    return [f"double rise_{k}[{n}], offset_{k}[{n}], factors_{k}[{n * n}];", f"int active_{k}[{n}], count_{k};"]


def solved(k: int, n: int, loop: Loop, out: str, near: str) -> list[str]:
    """Return the statements that solve the pattern for `out`; near: where inner steps begin."""
    if loop.inner:
        return [f"for (i = 0; i < {n}; i++) {out}[i] = {near}[i];", f"solve_pattern_{k}(s, c, {out});"]
    return [f"factor_{k}(s);", f"solve_pattern_{k}(s, c, {out});"]


def pattern_solution(k: int, units: Units, loop: Loop, cache: bool) -> list[str]:
    """Return the functions that solve eta = D (W eta + c) + offset for a pattern, on the units with a nonzero slope.

    Where the loop contracts, I - D W is diagonally dominant by rows once its columns are scaled by the weights, so
    elimination needs no pivots; the residual of what it finds is looked at in any case. With a cache the inverse is
    formed, column by column, at three times the cost: a pattern is then solved by one product. With inner steps the
    contraction goes on, on the units with a slope alone, as often as sampled measurements needed (`choice`).
    """
    if loop.inner:
        return inner_steps(k, units, loop.inner)
    n = len(units)
    at = f"a[j * {n} + i]" if cache else f"a[i * {n} + j]"
    factor = [f"for (i = 0; i < {n}; i++) if (s->rise_{k}[i] != 0.0) s->active_{k}[count++] = i;", f"s->count_{k} = count;",
              "for (i = 0; i < count; i++) {", f"    const double rise = s->rise_{k}[s->active_{k}[i]];",
              "    for (j = 0; j < count; j++)",
              f"        {at} = (i == j ? 1.0 : 0.0) - rise * loop_{k}[s->active_{k}[j] * {n} + s->active_{k}[i]];", "}",
              *(_inversion(n) if cache else _elimination(n))]
    solve = [*_resting(k, n, "z"), *(_product(k, n) if cache else _substitution(k, n)),
             f"for (i = 0; i < count; i++) eta[s->active_{k}[i]] = x[i];"]
    kind = pattern_type(k, cache)
    return [*function(f"static void factor_{k}({kind} *restrict s)",
                      [f"double *a = s->factors_{k};", "int i, j, k, count = 0;"], factor),
            *function(f"static void solve_pattern_{k}(const {kind} *s, const double *restrict c, double *restrict eta)",
                      [f"const double *a = s->factors_{k};", f"double x[{n}], z[{n}];",
                       f"const int count = s->count_{k};", f"int i, {'j, ' if cache else ''}fixed = 0;"], solve)]


def inner_steps(k: int, units: Units, steps: int) -> list[str]:
    """Return the function that takes contraction steps for a pattern, from eta: rows and columns of W with a slope, in one
    block filled up with zeros to a multiple of four."""
    n, room = len(units), padded(len(units))
    body = [f"for (i = 0; i < {n}; i++) {{", "    active[count] = i;", f"    rise[count] = s->rise_{k}[i];",
            f"    count += s->rise_{k}[i] != 0.0;", "}",
            "for (size = count; size % 4 != 0; size++) { active[size] = 0; rise[size] = 0.0; }",
            "for (i = 0; i < size; i++) {", "    x[i] = i < count ? eta[active[i]] : 0.0;",
            f"    rest[i] = i < count ? s->offset_{k}[active[i]] : 0.0;", "}", *_resting(k, n, "far"),
            "for (j = 0; j < size; j++) {", f"    const double *restrict column = loop_{k} + active[j] * {n};",
            f"    at[j] = j * {room};", "    drive[j] = far[active[j]];",
            f"    double *restrict own = block + j * {room};", "    for (i = 0; i < size; i += 4) {",
            *(f"        own[{at}] = column[active[{at}]];" for at in ("i", "i + 1", "i + 2", "i + 3")), "    }", "}",
            f"for (k = 0; k < {steps}; k++) {{", "    columns(size, size, at, x, block, drive, z);",
            "    for (i = 0; i < size; i++) x[i] = rise[i] * z[i] + rest[i];",
            "}", "for (i = 0; i < count; i++) eta[active[i]] = x[i];"]
    return function(f"static void solve_pattern_{k}(const pattern_{k} *s, const double *restrict c, double *restrict eta)",
                    [f"double block[{room * room}], far[{n}];",
                     ", ".join(f"{name}[{room}]" for name in ("double rise", "rest", "drive", "x", "z")) + ";",
                     f"int active[{room}], at[{room}], i, j, k, count = 0, fixed = 0, size;"], body)


def _resting(k: int, n: int, z: str) -> list[str]:
    """The drive of the units with a slope: c and what the others, at rest on their offsets, give to it."""
    return [f"for (i = 0; i < {n}; i++) {{", f"    eta[i] = s->rise_{k}[i] == 0.0 ? s->offset_{k}[i] : 0.0;",
            "    fixed |= eta[i] != 0.0;", "}", f"if (fixed) preactivation_{k}(c, eta, {z});",
            f"else for (i = 0; i < {n}; i++) {z}[i] = c[i];"]


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
