"""A predictive law as C for a board: written, compiled, and run in closed loop in C against the simulation in Python.

The law looks four samples ahead under |u| <= 1. As an implicit network of four units it has loops in W, which the C solves
with a proved error and a proved number of steps, in double precision. For a processor that has single precision only, loops
this stiff would leave a bound of 0.2; written out as layers, over what the sensors can show, the same law keeps one of 1e-4.
The board is played by the system's C compiler; without one only the promises are printed.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from inc_casadi import INC, MPC, Box, Plant, Regional, certify, simulate
from inc_casadi.interchange.c_code import CSource
from inc_casadi.pieces.regions import regions

SAMPLES, REPEATS = 200, 50
START, LIMITS = (0.8, 0.3), Box([-1.0], [1.0])
COST = 1.364978

PROGRAM = """\
#include <stdio.h>
#include <time.h>
#include "{name}.h"

int main(void)
{{
    int k, r, most = 0;
    clock_t begin = clock();
    for (r = 0; r < {repeats}; r++) {{                        /* the same motion several times, to be timed */
        double x[2] = {{{start}}};
        for (k = 0; k < {samples}; k++) {{
            const {word} y[2] = {{({word})x[0], ({word})x[1]}};   /* what the sensors measure */
            const double x0 = x[0];
            {word} u[1];
            const int steps = {name}(y, u);
            if (steps < 0) return 1;                         /* a loop missed its tolerance: a fault */
            most = steps > most ? steps : most;
            if (r == 0) printf("%.17g\\n", (double)u[0]);
            x[0] = {a00} * x0 + {a01} * x[1] + {b0} * (double)u[0];
            x[1] = {a10} * x0 + {a11} * x[1] + {b1} * (double)u[0];
        }}
    }}
    printf("%d %.17g\\n", most, 1e6 * (double)(clock() - begin) / CLOCKS_PER_SEC / ({samples}.0 * {repeats}.0));
    return 0;
}}
"""


def on_the_board(plant: Plant, source: CSource, folder: Path, compiler: str) -> tuple[np.ndarray, int, float]:
    """Return the inputs (SAMPLES,) of the closed loop in C, the most steps that a sample took, and microseconds for each."""
    source.write(folder)
    entries = {f"a{i}{j}": repr(float(plant.A[i, j])) for i in range(2) for j in range(2)}
    entries |= {f"b{i}": repr(float(plant.B[i, 0])) for i in range(2)}
    (folder / "main.c").write_text(PROGRAM.format(name=source.name, word=source.precision, samples=SAMPLES, repeats=REPEATS,
                                                  start=", ".join(map(repr, START)), **entries))
    subprocess.run([compiler, "-std=c99", "-O2", "main.c", f"{source.name}.c", "-o", source.name], cwd=folder, check=True)
    lines = subprocess.run([str(folder / source.name)], check=True, capture_output=True, text=True).stdout.splitlines()
    steps, time = lines[-1].split()
    return np.array([float(line) for line in lines[:-1]]), int(steps), float(time)


def main() -> tuple[dict[str, float], dict[str, float]]:
    """Print sizes, times and error bounds, and return computed and expected figures by name."""
    plant = Plant(A=[[1.1, 1.0], [0.0, 1.02]], B=[[0.2], [0.5]])
    claim = Regional(Box([-0.8, -0.8], [0.8, 0.8]), LIMITS, np.eye(2), [[0.05]], 0.98)
    measured = Box([-2.0, -2.0], [2.0, 2.0])                           # what the sensors can show
    implicit = MPC(plant, np.eye(2), [[0.05]], 4, LIMITS).inc()
    layers = INC.from_affine_pieces(regions(plant, implicit, measured))
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    computed: dict[str, float] = {}
    expected: dict[str, float] = {}
    for name, law, precision, near in (("implicit", implicit, "double", 1e-8), ("layers", layers, "float", 1e-4)):
        certificate = certify(plant, law, claim).require()
        source = law.to_c(name, inputs=measured, limits=LIMITS, certificate=certificate, precision=precision)
        print(f"\n{source}\n  certified cost {certificate.bound:.6f}; {law.q} units, {source.numbers} constants, at most "
              f"{source.stack} bytes of stack")
        computed |= {f"{name}: certified cost": certificate.bound,
                     f"{name}: error bound below {near:g}": float(source.error_bound < near)}
        expected |= {f"{name}: certified cost": COST, f"{name}: error bound below {near:g}": 1.0}
        if compiler is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            u, steps, time = on_the_board(plant, source, Path(folder), compiler)
        off = float(np.max(np.abs(u - simulate(plant, law, START, steps=SAMPLES).u[0, :SAMPLES])))
        print(f"  {SAMPLES} samples in C take {time:.2f} us each, the plant included, and {steps} steps of "
              f"{source.iterations} at most; u differs from Python's by {off:.2g}")
        computed |= {f"{name}: the loop in C is that in Python": float(off < 0.1 * near),
                     f"{name}: steps as promised": float(steps <= source.iterations)}
        expected |= {f"{name}: the loop in C is that in Python": 1.0, f"{name}: steps as promised": 1.0}
    return computed, expected


if __name__ == "__main__":
    print(main())
