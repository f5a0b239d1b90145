"""Whatever is measured, the C ends after the promised steps, touches its own memory only, and says NaN where it must."""

from __future__ import annotations

import subprocess

import numpy as np
import posed
import pytest
from c_compiler import STRICT, compiled, compiler, in_long_doubles
from draws import controller, points

from inc_casadi import INC, Box, ReLU, Saturation, Tanh
from inc_casadi.interchange.c_code import to_c

PIECES = (ReLU(), Saturation(), ReLU(), ReLU(), Saturation())
HUGE = 1.7e308
ODD = np.array([[np.nan, 0.0, 0.0], [0.0, np.inf, 0.0], [0.0, 0.0, -np.inf], [np.nan, np.inf, np.nan],
                [np.inf, np.inf, -np.inf], [HUGE, -HUGE, HUGE], [-HUGE, 0.0, 5e-324], [1e200, 1e-200, -1e200],
                [0.5, -1.0, 2.0], [-3.0, 0.1, 0.2], [0.0, 0.0, 0.0]]).T


def laws():
    """A source of every kind, by name."""
    rng = np.random.default_rng(0)
    loop = controller(rng, m=2, p=3, units=PIECES, norm=0.9, bias=0.3)
    wide = controller(rng, m=2, p=3, units=PIECES * 3, norm=0.4, bias=0.3).with_saturated_output(Box([-1.0] * 2, [1.0] * 2))
    multiplier = posed.controller(np.random.default_rng(9), PIECES, kind="skew")
    curved = controller(rng, m=1, p=3, units=(Tanh(), ReLU(), Tanh()), norm=0.9)
    kinds = {"one": (INC.saturated([[1.0, -2.0, 3.0]], 1.0), {}), "contraction": (wide, {"method": "contraction"}),
             "inner": (wide, {"method": "newton", "limits": Box([-1.0] * 2, [1.0] * 2)}),
             "elimination": (loop, {"method": "newton"}),
             "cached": (loop, {"cache": True}), "trials": (multiplier, {}), "kept": (multiplier, {"cache": True}),
             "splitting": (multiplier, {"method": "splitting"}), "curved": (curved, {"method": "newton"}),
             "single": (wide, {"precision": "float"}), "single_kept": (multiplier, {"precision": "float", "cache": True})}
    return {name: to_c(inc, name, **options) for name, (inc, options) in kinds.items()}


MAIN = """\
#include <stdio.h>
{includes}
static const double odd[] = {{{odd}}};
{states}
int main(void)
{{
    int k, j;
    for (k = 0; k < {count}; k++) {{
{calls}
    }}
    return 0;
}}
"""

CALL = """\
        {{ {word} y[3], u[{m}]; int steps; for (j = 0; j < 3; j++) y[j] = ({word})odd[3 * k + j];
        steps = {name}({state}y, u); if (steps > {most} || steps < -{most}) return 1;
        printf("{name} %d %d", k, steps); for (j = 0; j < {m}; j++) printf(" %g", (double)u[j]); puts(""); }}"""


def test_odd_measurements_end_within_the_promised_steps_and_memory(tmp_path):
    sources = laws()
    calls, states = [], []
    for name, source in sources.items():
        source.write(tmp_path)
        cached = f"{name}_state" in source.header
        states += [f"static {name}_state {name}_kept;"] if cached else []
        m = int(source.header.split("_OUTPUTS ")[1].split()[0])
        calls.append(CALL.format(word=source.precision, m=m, name=name, most=source.iterations,
                                 state=f"&{name}_kept, " if cached else ""))
    words = {"nan": "0.0 / 0.0", "inf": "1.0 / 0.0", "-inf": "-1.0 / 0.0"}
    odd = ", ".join(words.get(str(value), value.hex()) for value in ODD.T.ravel())
    (tmp_path / "main.c").write_text(MAIN.format(includes="\n".join(f'#include "{name}.h"' for name in sources), odd=odd,
                                                 states="\n".join(states), count=ODD.shape[1], calls="\n".join(calls)))
    flags = ["-fsanitize=undefined,address", "-fno-sanitize-recover=all", "main.c", *(f"{name}.c" for name in sources)]
    command = [compiler(), "-std=c99", *flags, "-o", "main", "-lm"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    if built.returncode != 0 and ".c:" not in built.stderr:
        pytest.skip(f"the compiler has no sanitizers: {built.stderr.strip()[-200:]}")
    assert built.returncode == 0, built.stderr
    run = subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, timeout=20)
    assert run.returncode == 0, run.stderr
    for line in run.stdout.splitlines():
        name, k, steps, *u = line.split()
        wrong = not np.all(np.isfinite(ODD[:, int(k)])) or ("single" in name and np.abs(ODD[:, int(k)]).max() > 1e39)
        assert not wrong or (int(steps) == 0 and all("nan" in value for value in u)), line
        assert int(k) != ODD.shape[1] - 1 or all("nan" not in value and "inf" not in value for value in u), line


@pytest.mark.parametrize("kind", ["contracting", "multiplier"])
def test_a_kept_pattern_survives_odd_measurements(kind: str, tmp_path):
    rng = np.random.default_rng(1)
    inc = (controller(rng, m=2, p=3, units=PIECES, norm=0.9, bias=0.3) if kind == "contracting"
           else posed.controller(np.random.default_rng(9), PIECES, kind="skew"))
    y = np.repeat(points(rng, 3, ODD.shape[1]), 2, axis=1)
    y[:, ::2] = ODD
    u, steps = compiled(to_c(inc, cache=True), tmp_path)(y)
    want = in_long_doubles(inc, y[:, 1::2])
    assert np.all(np.abs(u[:, 1::2] - want) <= 1e-11 * (1 + np.abs(want))) and np.all(steps[1::2] > 0)


def test_clipping_leaves_a_measurement_that_is_no_number_visible(tmp_path):
    u, _ = compiled(to_c(INC.linear([[1.0]]), limits=Box([-1.0], [1.0])), tmp_path)([[np.nan, 5.0]])
    assert np.isnan(u[0, 0]) and u[0, 1] == 1.0


def test_wrong_inner_steps_only_cost_time(tmp_path):
    inc = controller(np.random.default_rng(2), m=2, p=3, units=PIECES * 4, norm=0.4, bias=0.3)
    source = to_c(inc, method="newton")
    right, wrong = "x[i] = rise[i] * z[i] + rest[i];", "x[i] = 1.5 * rise[i] * z[i] + rest[i];"
    assert source.source.count(right) == 1
    y = points(np.random.default_rng(3), 3, 50)
    good, few = compiled(source, tmp_path / "good")(y)
    bad, many = compiled(source, tmp_path / "bad", change=lambda text: text.replace(right, wrong))(y)
    want = in_long_doubles(inc, y)
    assert all(np.all(np.abs(u - want) <= 1e-12 * (1 + np.abs(want))) for u in (good, bad))
    assert np.median(few) == 3 and few.max() < many.mean() and many.max() <= source.iterations


def test_fast_math_is_refused_in_part_too(tmp_path):
    to_c(INC.linear([[1.0]])).write(tmp_path)
    command = [compiler(), *STRICT, "-ffinite-math-only", "-c", "inc.c"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode != 0 and "IEEE 754" in run.stderr
