"""Generated C, compiled with the system's compiler and called from Python; tests are skipped where there is none."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from inc_casadi.activations.stack import derivative

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Wshadow",
          "-Wdouble-promotion", "-Werror")

MANY = """\
#include "{name}.c"
{state}
void many(int count, const {word} *y, {word} *u, int *steps)
{{
    int k;
    for (k = 0; k < count; k++) steps[k] = {name}({pointer}y + k * {p}, u + k * {m});
}}
"""


def compiler():
    """The system's C compiler, or a skipped test."""
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if found is None:
        pytest.skip("no C compiler is installed")
    return found


def compilers():
    """Every C compiler found, for warnings that one has and another has not."""
    return [path for path in map(shutil.which, ("gcc", "clang")) if path is not None] or [compiler()]


def compiled(source, folder, *flags, change=lambda text: text):
    """The function of a `CSource`: columns y (p, N) to u (m, N) and returned steps (N,); change: edits its text first.

    In single precision y is rounded to floats first.
    """
    command = [compiler(), *STRICT, *(flags or ("-O1",))]
    source.write(folder)
    path = folder / f"{source.name}.c"
    path.write_text(change(path.read_text()))
    p, m = (int(source.header.split(f"{source.name.upper()}_{what} ")[1].split()[0]) for what in ("MEASUREMENTS", "OUTPUTS"))
    cached = f"{source.name}_state" in source.header
    text = MANY.format(name=source.name, state=f"static {source.name}_state state;" if cached else "",
                       pointer="&state, " if cached else "", p=p, m=m, word=source.precision)
    (folder / "many.c").write_text(text)
    subprocess.run([*command, "-shared", "-fPIC", str(folder / "many.c"), "-o", str(folder / "many.so"), "-lm"], check=True)
    kind = np.float32 if source.precision == "float" else np.float64
    library = ctypes.CDLL(str(folder / "many.so"))

    def call(y):
        y = np.ascontiguousarray(np.asarray(y, dtype=kind).T)
        u, steps = np.full((len(y), m), np.nan, dtype=kind), np.zeros(len(y), dtype=np.intc)
        library.many(len(y), *(array.ctypes.data_as(ctypes.c_void_p) for array in (y, u, steps)))
        return u.T.astype(float), steps
    return call


def in_long_doubles(inc, y):
    """u (m, N) in the longest floats there are: the law's own eta, improved by Newton steps on residuals in long doubles."""
    wide = [np.asarray(part, dtype=np.longdouble) for part in (inc.W, inc.U, inc.V, inc.K, inc.b, inc.d, y)]
    W, U, V, K, b, d, y = wide
    eta, c = inc.hidden(np.asarray(y, dtype=float)).astype(np.longdouble), U @ y + b[:, None]
    for _ in range(6):
        z = W @ eta + c
        image = np.array([unit.formula(row, np) for unit, row in zip(inc.activations, z, strict=True)]).reshape(z.shape)
        slope = derivative(inc.activations, z.astype(float)).T[:, :, None]
        step = np.linalg.solve(np.eye(inc.q) - slope * inc.W, (image - eta).astype(float).T[:, :, None])[:, :, 0].T
        eta = eta + step
    return (K @ y + V @ eta + d[:, None]).astype(float)
