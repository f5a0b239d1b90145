"""Time C inside C: a small program walks through points, so that no call from Python is counted."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from inc_casadi.arrays import Array
from inc_casadi.interchange.c_code import CSource

FLAGS, NATIVE = ("-std=c99", "-O3"), ("-march=native",)  # portable, and what is added for this processor alone
LEAST_SECONDS, ROUNDS = 0.02, 3

PROGRAM = """\
#include <stdio.h>
#include <time.h>
#include "{included}"
static const {word} points[] = {{{points}}};
{setup}
int main(void)
{{
    {word} u[{m}];
    double sum = 0.0, best = 1e9;
    long repeats = 1;
    int round = 0;
    while (round < {rounds}) {{
        clock_t start = clock();
        double seconds;
        long r;
        int k;
        for (r = 0; r < repeats; r++)
            for (k = 0; k < {count}; k++) {{
                {call}
                sum += (double)u[0];
            }}
        seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
        if (seconds < {least}) {{ repeats *= 2; continue; }}
        if (seconds / (repeats * {count}.0) < best) best = seconds / (repeats * {count}.0);
        round++;
    }}
    printf("%.17g %.17g\\n", best, sum);
    return 0;
}}
"""


@dataclass(frozen=True)
class Timed:
    """Microseconds of CPU time per evaluation, portable and compiled for this processor; bytes of portable code and data."""

    microseconds: float
    native: float
    size: int


def compiler() -> str | None:
    """Return the path of the system's C compiler, or None."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def time_law(source: CSource, y: Array, folder: Path) -> Timed:
    """Return the time of a generated law at the points y (p, N), one after the other."""
    source.write(folder)
    cached = f"{source.name}_state" in source.header
    call = f"{source.name}({'&state, ' if cached else ''}points + k * {y.shape[0]}, u);"
    outputs = int(source.header.split("_OUTPUTS ")[1].split()[0])
    return _timed(folder, f"{source.name}.c", y, outputs, f"static {source.name}_state state;" if cached else "", call,
                  source.precision)


def time_casadi(function: Any, y: Array, folder: Path) -> Timed:
    """Return the time of the C that CasADi generates for a Function y -> (u, ...), at the points y (p, N)."""
    import casadi as ca

    folder.mkdir(parents=True, exist_ok=True)
    generator = ca.CodeGenerator("casadi_law.c")
    generator.add(function)
    generator.generate(f"{folder}/")
    kinds = {"const double *": ("arg", function.sz_arg()), "double *": ("res", function.sz_res()),
             "casadi_int ": ("iw", function.sz_iw()), "double ": ("work", function.sz_w())}
    setup = "\n".join(f"static {kind}{array}[{max(1, int(size))}];" for kind, (array, size) in kinds.items())
    call = f"arg[0] = points + k * {y.shape[0]}; res[0] = u; res[1] = 0; {function.name()}(arg, res, iw, work, 0);"
    return _timed(folder, "casadi_law.c", y, int(function.size1_out(0)), setup, call)


def _timed(folder: Path, included: str, y: Array, outputs: int, setup: str, call: str, word: str = "double") -> Timed:
    points = ", ".join(float(entry).hex() + "f" * (word == "float") for entry in y.T.ravel())
    text = PROGRAM.format(included=included, points=points, setup=setup, m=outputs, rounds=ROUNDS, count=y.shape[1],
                          call=call, least=LEAST_SECONDS, word=word)
    (folder / "program.c").write_text(text, encoding="ascii")
    found = compiler()
    if found is None:
        raise RuntimeError("no C compiler was found")
    times = [_least(folder, [found, *FLAGS, *more]) for more in ((), NATIVE)]
    subprocess.run([found, *FLAGS, "-c", included, "-o", "law.o"], cwd=folder, check=True, capture_output=True)
    return Timed(times[0], times[1], _loaded_bytes(folder / "law.o"))


def _least(folder: Path, command: list[str]) -> float:
    """Compile and run the program, and return microseconds per evaluation."""
    subprocess.run([*command, "program.c", "-o", "program", "-lm"], cwd=folder, check=True, capture_output=True)
    run = subprocess.run([str(folder / "program")], check=True, capture_output=True, text=True, timeout=120)
    return 1e6 * float(run.stdout.split()[0])


def _loaded_bytes(path: Path) -> int:
    """Bytes of code and data as `size` counts them, of the whole file where that tool is missing."""
    tool = shutil.which("size")
    if tool is None:
        return path.stat().st_size
    run = subprocess.run([tool, str(path)], check=True, capture_output=True, text=True)
    return int(run.stdout.splitlines()[1].split()[3])
