"""The promised numbers of steps and bytes: monotone where that is said, and what a compiler needs of the stack."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import posed
import pytest
from draws import controller

from inc_casadi import INC, ReLU, Saturation, Tanh
from inc_casadi.interchange.c_code import to_c
from inc_casadi.interchange.c_code.stack import FRAME, deepest, frames

PIECES = (ReLU(), Saturation(), ReLU(), ReLU(), Saturation())


def family(kind):
    """kappa W0 for a W0 of Perron-Frobenius radius 1, with signs or without, and one with ||W0|| = 1 of eight units.

    The last takes trials in fewer operations than steps at some coarse tolerances, and in more at others between them.
    """
    rng = np.random.default_rng(0 if kind == "wide" else 3)
    W = rng.normal(size=(5, 5)) if kind != "wide" else rng.normal(size=(8, 8))
    W = np.abs(W) if kind == "positive" else W
    W /= np.abs(W).sum(axis=1).max() if kind == "wide" else np.max(np.abs(np.linalg.eigvals(np.abs(W))))
    U, V, b = rng.normal(size=(len(W), 2)), rng.normal(size=(1, len(W))), rng.normal(size=len(W))
    return lambda kappa: INC(kappa * W, U, V, [[0.0, 0.0]], b)


@pytest.mark.parametrize("kind", ["positive", "signed", "wide"])
@pytest.mark.parametrize("method", ["auto", "contraction", "newton"])
def test_the_promised_steps_never_fall_with_the_tolerance(method: str, kind: str):
    inc = family(kind)(0.7)
    counts = [to_c(inc, method=method, tol=tol).iterations for tol in (*np.geomspace(1e-2, 1e-3, 8), 1e-9, 1e-15)]
    assert np.all(np.diff(counts) >= 0) and counts[-1] > counts[0]


@pytest.mark.parametrize("method", ["contraction", "newton"])
def test_the_promised_steps_of_a_contraction_never_fall_with_kappa(method: str):
    counts = [to_c(family("positive")(kappa), method=method).iterations for kappa in np.linspace(0.05, 0.95, 6)]
    assert np.all(np.diff(counts) > 0)


def test_they_fall_where_a_multiplier_takes_over_and_nowhere_else():
    inc = family("signed")
    below, above = (to_c(inc(kappa), method="newton") for kappa in (0.999, 1.001))
    assert below.methods == ("newton",) and above.methods == ("newton and splitting",)
    assert below.iterations > 10_000 > 100 > above.iterations


def test_the_promised_steps_under_a_multiplier_never_fall_with_the_tolerance():
    inc = posed.controller(np.random.default_rng(9), PIECES, kind="skew")
    counts = [to_c(inc, method="splitting", tol=tol).iterations for tol in (1e-3, 1e-6, 1e-9, 1e-13)]
    assert np.all(np.diff(counts) > 0)


LAWS = {"linear": (INC.linear([[1.0, 2.0]]), {}),
        "brief": (controller(np.random.default_rng(0), p=2, units=PIECES, norm=0.9), {"method": "newton"}),
        "steps": (controller(np.random.default_rng(1), p=2, units=PIECES * 5, norm=0.3), {"method": "newton"}),
        "plain": (controller(np.random.default_rng(1), p=2, units=PIECES * 5, norm=0.3), {"method": "contraction"}),
        "cached": (controller(np.random.default_rng(2), p=2, units=PIECES * 3, norm=0.9), {"cache": True}),
        "curved": (controller(np.random.default_rng(2), p=2, units=(Tanh(), ReLU()), norm=0.9), {"precision": "float"}),
        "split": (posed.controller(np.random.default_rng(9), PIECES, kind="skew"), {}),
        "single": (posed.controller(np.random.default_rng(9), PIECES, kind="skew"), {"precision": "float"})}


@pytest.mark.parametrize("level", ["-O0", pytest.param("-O2", marks=pytest.mark.slow)])
def test_the_stated_stack_is_what_the_compiler_takes_at_most(level: str, tmp_path):
    found = shutil.which("gcc")
    if found is None:
        pytest.skip("gcc, which tells the stack of each function, is not installed")
    sources = {name: to_c(inc, name, **options) for name, (inc, options) in LAWS.items()}
    for source in sources.values():
        source.write(tmp_path)
    files = [f"{name}.c" for name in sources]
    subprocess.run([found, "-std=c99", level, "-fstack-usage", "-c", *files], cwd=tmp_path, check=True)
    for name, source in sources.items():
        taken = {}
        for line in (tmp_path / f"{name}.su").read_text().splitlines():
            place, size, _ = line.split("\t")
            taken[place.split(":")[-1].split(".")[0]] = int(size)
        calls = {head: (taken.get(head, 0), others) for head, (_, others) in frames(source.source.splitlines()).items()}
        assert deepest(calls, name, 0) <= source.stack and f"_STACK {source.stack}\n" in source.header
        if level == "-O0":  # nothing is inlined, so each function can be looked at by itself
            spare = [calls[head][0] - arrays for head, (arrays, _) in frames(source.source.splitlines()).items()]
            assert min(spare) >= 0 and max(spare) <= FRAME, name


def test_the_stack_of_a_law_by_hand():
    source = to_c(INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), method="contraction")
    arrays = 2 * 8 + 2 * 8  # eta and z of one unit in the function itself, z and next where the loop is solved
    assert source.stack == arrays + 3 * FRAME
    single = to_c(INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), method="contraction", precision="float")
    assert single.stack == arrays // 2 + 3 * FRAME
