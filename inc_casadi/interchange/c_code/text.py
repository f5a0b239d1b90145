"""C text: constant arrays, products with them in a form that compilers vectorize, and activations over ranges of units."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from ...activations.stack import Units, groups
from ...arrays import Array
from .expressions import number, slope, value

FEW_ROWS, MANY_ROWS = 4, 12  # a product with fewer rows goes row by row, one with many through the function below

COLUMNS = """\
static void columns(int rows, int count, const int *restrict at, const double *restrict x, const double *restrict matrix,
                    const double *from, double *z)
{
    int i, j;
    for (j = 0; j < count; j += 4) {
        const double *restrict a = matrix + at[j], *restrict b = matrix + at[j + 1];
        const double *restrict c = matrix + at[j + 2], *restrict d = matrix + at[j + 3];
        const double p = x[j], q = x[j + 1], r = x[j + 2], s = x[j + 3];
        for (i = 0; i + 4 <= rows; i += 4) {
            const double f0 = from[i], f1 = from[i + 1], f2 = from[i + 2], f3 = from[i + 3];
            z[i] = f0 + ((a[i] * p + b[i] * q) + (c[i] * r + d[i] * s));
            z[i + 1] = f1 + ((a[i + 1] * p + b[i + 1] * q) + (c[i + 1] * r + d[i + 1] * s));
            z[i + 2] = f2 + ((a[i + 2] * p + b[i + 2] * q) + (c[i + 2] * r + d[i + 2] * s));
            z[i + 3] = f3 + ((a[i + 3] * p + b[i + 3] * q) + (c[i + 3] * r + d[i + 3] * s));
        }
        for (; i < rows; i++) z[i] = from[i] + ((a[i] * p + b[i] * q) + (c[i] * r + d[i] * s));
        from = z;
    }
}
""".splitlines()
"""z += the columns that start at matrix + at[j], times x[j]; count is a multiple of 4. The four sums side by side are what
compilers vectorize, at -O2 too, without licence to reorder."""


def constants(name: str, array: Array) -> list[str]:
    """Return the definition of an array of doubles, matrices column by column, those with few rows row by row.

    >>> constants("a", np.array([1.0, -0.5]))
    ['static const double a[2] = {1.0, -0.5};']
    """
    flat = array.ravel(order="C" if _by_rows(array) else "F")
    entries = [number(entry) for entry in flat]
    head = f"static const double {name}[{len(entries)}] = {{"
    if len(entries) <= 4:
        return [head + ", ".join(entries) + "};"]
    lines = ["    " + ", ".join(entries[k: k + 5]) + "," for k in range(0, len(entries), 5)]
    return [head, *lines[:-1], lines[-1].rstrip(",") + "};"]


def _by_rows(array: Array) -> bool:
    return array.ndim == 2 and array.shape[0] < FEW_ROWS


def add_product(name: str, matrix: Array, x: str, z: str, skips: bool = False) -> list[str]:
    """Return statements for z += matrix x, where `constants` has defined the matrix as `name`; i and j are its counters.

    Few rows have four partial sums each; some rows go four columns at a time; many rows through `COLUMNS`, with the columns
    left out that skips says may have an x of zero. The order of the sums is thus not that of the text of the law, which
    the error bound allows for (`sizes.evaluation_error`).

    >>> print("\\n".join(add_product("a", np.ones((4, 1)), "x", "z")))
    for (i = 0; i < 4; i++) z[i] += a[i] * x[0];
    """
    rows, columns = matrix.shape
    if not matrix.any():
        return []
    if _by_rows(matrix):
        return _row_products(name, rows, columns, x, z)
    if skips and rows >= MANY_ROWS and columns > 4:
        return _listed(name, rows, columns, x, z)
    four = columns - columns % 4
    lines = []
    if four:
        lines = [f"for (j = 0; j < {four}; j += 4) {{", f"    const double *restrict column = {name} + j * {rows};",
                 f"    const double t0 = {x}[j], t1 = {x}[j + 1], t2 = {x}[j + 2], t3 = {x}[j + 3];",
                 f"    for (i = 0; i < {rows}; i++)",
                 f"        {z}[i] += (column[i] * t0 + column[i + {rows}] * t1)"
                 f" + (column[i + {2 * rows}] * t2 + column[i + {3 * rows}] * t3);", "}"]
    for j in range(four, columns):
        at = f"i + {j * rows}" if j else "i"
        lines.append(f"for (i = 0; i < {rows}; i++) {z}[i] += {name}[{at}] * {x}[{j}];")
    return lines


def _listed(name: str, rows: int, columns: int, x: str, z: str) -> list[str]:
    """Those columns first listed whose entry of x is not zero; the list is filled up to a multiple of four."""
    room = padded(columns)
    return ["{", f"    int at[{room}], count = 0;", f"    double t[{room}];", f"    for (j = 0; j < {columns}; j++) {{",
            f"        at[count] = {rows} * j;", f"        t[count] = {x}[j];", f"        count += {x}[j] != 0.0;", "    }",
            "    for (; count % 4 != 0; count++) { at[count] = 0; t[count] = 0.0; }",
            f"    columns({rows}, count, at, t, {name}, {z}, {z});", "}"]


def padded(size: int) -> int:
    """Return the next multiple of four.

    >>> padded(5), padded(8)
    (8, 8)
    """
    return size + -size % 4


def _row_products(name: str, rows: int, columns: int, x: str, z: str) -> list[str]:
    four, lines = columns - columns % 4, []
    for row in range(rows):
        at = row * columns
        ends = " + ".join([f"{name}[{at + j}] * {x}[{j}]" for j in range(four, columns)])
        if four == 0:
            lines.append(f"{z}[{row}] += {ends};")
            continue
        lines += ["{", "    double s0 = 0.0, s1 = 0.0, s2 = 0.0, s3 = 0.0;", f"    for (j = 0; j < {four}; j += 4) {{"]
        lines += [f"        s{k} += {name}[j + {at + k}] * {x}[j + {k}];" for k in range(4)]
        lines += ["    }", f"    {z}[{row}] += ((s0 + s1) + (s2 + s3)){' + ' + ends if ends else ''};", "}"]
    return lines


def runs(units: Units) -> list[tuple[int, int, int]]:
    """Return (first, end, an index of the unit) for each run of equal units.

    >>> from inc_casadi import ReLU, Tanh
    >>> runs((ReLU(), ReLU(), Tanh()))
    [(0, 2, 0), (2, 3, 2)]
    """
    out: list[tuple[int, int, int]] = []
    for _, rows in groups(units):
        breaks = np.flatnonzero(np.diff(rows) != 1) + 1
        out += [(int(part[0]), int(part[-1]) + 1, int(part[0])) for part in np.split(rows, breaks)]
    return sorted(out)


def applied(units: Units, z: str, out: str) -> list[str]:
    """Return loops for out[i] = phi_i(z[i])."""
    return [f"for (i = {a}; i < {b}; i++) {out}[i] = {value(units[k], f'{z}[i]')};" for a, b, k in runs(units)]


def tangents(units: Units, z: str, at: str, rise: str, offset: str) -> list[str]:
    """Return loops for the tangent rise z + offset of each unit at z[i], with at[i] = phi(z[i])."""
    lines = [f"for (i = {a}; i < {b}; i++) {rise}[i] = {slope(units[k], f'{z}[i]', f'{at}[i]')};" for a, b, k in runs(units)]
    return [*lines, f"for (i = 0; i < {len(units)}; i++) {offset}[i] = {at}[i] - {rise}[i] * {z}[i];"]


def may_vanish(units: Units) -> bool:
    """Return whether a unit is zero on a whole interval, as a ReLU is.

    >>> from inc_casadi import ReLU, Tanh
    >>> may_vanish((Tanh(),)), may_vanish((Tanh(), ReLU()))
    (False, True)
    """
    pieces = [unit.pieces for unit in set(units)]
    return any(bool(np.any((part.slopes == 0) & (part.intercepts == 0))) for part in pieces if part is not None)


def function(head: str, declarations: Iterable[str], body: Iterable[str]) -> list[str]:
    """Return a function definition with its body indented."""
    lines = [*declarations, *body]
    return [head, "{", *(f"    {line}" if line else line for line in lines), "}", ""]


def counters(body: Iterable[str], names: str = "ijk") -> list[str]:
    """Return the declaration of those counters that the body uses, so that none is unused.

    >>> counters(["for (i = 0; i < 2; i++) z[i] = 0.0;"])
    ['int i;']
    """
    text = "\n".join(body)
    used = [name for name in names if re.search(rf"\b{name}\b", text)]
    return [f"int {', '.join(used)};"] if used else []
