"""One control value at a time, microseconds: Python calls, CasADi's C, and the C of `to_c`, side by side in one run."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from inc_casadi import INC
from inc_casadi.arrays import Array
from inc_casadi.interchange.c_code import to_c

from .compiled import FLAGS, NATIVE, compiler, time_casadi, time_law
from .evaluation import MEASUREMENTS, OUTPUTS, SIZES, random_law

NORMS, POINTS, STEP = (0.5, 0.9), 100, 1e-3
METHODS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("C, as to_c chooses", {}), ("C, contraction", {"method": "contraction"}), ("C, Newton", {"method": "newton"}),
    ("C, last pattern kept", {"cache": True}), ("C, single precision", {"precision": "float"}))
ONE_PASS: tuple[tuple[str, dict[str, Any]], ...] = (("C, one pass", {}), ("C, single precision", {"precision": "float"}))
CASADI_C, NUMPY = "CasADi's C", "NumPy, one call"


@dataclass(frozen=True)
class Single:
    """Microseconds of one evaluation with q units and ||W||_inf = norm (0: feedforward).

    size: bytes of code and data; native: microseconds when compiled for this processor alone.
    """

    q: int
    norm: float
    way: str
    microseconds: float
    size: int | None = None
    native: float | None = None


def single_evaluation(sizes: tuple[int, ...] = SIZES, norms: tuple[float, ...] = NORMS) -> list[Single]:
    """Return the times of one evaluation, for random laws with a full W and, with norm 0, feedforward ones of two layers.

    C is timed inside C with its own loop (CPU time, least of three rounds, `flags`, and once more for this processor alone),
    Python's ways with their calls, as they are used. The points are independent draws, but a walk with steps of 1e-3 where
    the last pattern is kept. C is left out where there is no compiler, onnxruntime where it is missing.
    """
    rows = [row for norm in norms for q in sizes for row in _of_law(random_law(q, norm=norm), q, norm)]
    return rows + [row for q in sizes for row in _of_law(two_layers(q), q, 0.0)]


def two_layers(q: int, seed: int = 0) -> INC:
    """Return a feedforward ReLU law with two layers of q / 2 units.

    >>> two_layers(8).q
    8
    """
    rng, half = np.random.default_rng(seed), q // 2
    sizes = (MEASUREMENTS, half, q - half, OUTPUTS)
    return INC.from_layers([(rng.standard_normal((b, a)) / np.sqrt(a), rng.standard_normal(b))
                            for a, b in zip(sizes, sizes[1:], strict=False)])


def _of_law(inc: INC, q: int, norm: float) -> Iterator[Single]:
    rng = np.random.default_rng(1)
    y = rng.standard_normal((inc.p, POINTS))
    walk = y[:, :1] + STEP * np.cumsum(rng.standard_normal((inc.p, POINTS)), axis=1)
    yield Single(q, norm, NUMPY, _called(inc, y))
    function = inc.to_casadi()
    yield Single(q, norm, "CasADi, one call", _called(function, y))
    onnx = _onnx(inc) if norm == 0.0 else None
    if onnx is not None:
        yield Single(q, norm, "onnxruntime, one call", _called(onnx, y))
    if compiler() is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        timed = time_casadi(function, y, Path(folder) / "casadi")
        yield Single(q, norm, CASADI_C, timed.microseconds, timed.size, timed.native)
        for way, options in METHODS if norm > 0 else ONE_PASS:
            points = walk if options.get("cache") else y
            timed = time_law(to_c(inc, "law", **options), points, Path(folder) / way)
            yield Single(q, norm, way, timed.microseconds, timed.size, timed.native)


def _called(answer: Callable[[Array], Any], y: Array) -> float:
    """Return microseconds of CPU time per call, the least of three rounds over 20 points."""
    columns, best = list(y.T[:20]), np.inf
    for _ in range(3):
        start = time.process_time()
        for column in columns:
            answer(column)
        best = min(best, time.process_time() - start)
    return 1e6 * best / len(columns)


def _onnx(inc: INC) -> Callable[[Array], Any] | None:
    """Return a feedforward law as onnxruntime runs it, on one thread, or None where that is missing."""
    try:
        import onnxruntime

        from inc_casadi.interchange import to_onnx
    except ImportError:
        return None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(to_onnx(inc).SerializeToString(), options, providers=["CPUExecutionProvider"])
    return partial(_run, session, session.get_inputs()[0])


def _run(session: Any, entry: Any, y: Array) -> Any:
    return session.run(None, {entry.name: y.reshape([1 if isinstance(size, str) or size is None else size
                                                     for size in entry.shape])})


def single_table(rows: list[Single]) -> str:
    """Return the times as text, each also as a multiple of the fastest C of `to_c` for the same law, with the bytes of C.

    >>> print(single_table([Single(8, 0.5, "NumPy, one call", 100.0), Single(8, 0.5, "C, Newton", 0.25, 9000, 0.2)]))
       q  norm  way                      us  ratio  native   bytes
       8   0.5  NumPy, one call         100    400       -       -
       8   0.5  C, Newton              0.25      1     0.2    9000
    """
    lines = [f"{'q':>4}  {'norm':>4}  {'way':<21} {'us':>8} {'ratio':>6} {'native':>7} {'bytes':>7}"]
    for row in rows:
        law = [other for other in rows if (other.q, other.norm) == (row.q, row.norm)]
        own = [other.microseconds for other in law if other.way.startswith("C,")]
        ratio = f"{row.microseconds / min(own):.3g}" if own else "-"
        size = "-" if row.size is None else str(row.size)
        native = "-" if row.native is None else f"{row.native:.3g}"
        lines.append(f"{row.q:>4}  {row.norm:>4g}  {row.way:<21} {row.microseconds:>8.3g} {ratio:>6} {native:>7} {size:>7}")
    return "\n".join(lines)


def flags() -> str:
    """Return how the C is compiled: portably, and once more for the processor at hand.

    >>> flags()
    '-std=c99 -O3; native: -march=native too'
    """
    return f"{' '.join(FLAGS)}; native: {' '.join(NATIVE)} too"
