"""Write a law as self-contained C: layers in one pass, loops by steps whose number and outcome are proved."""

from __future__ import annotations

import re

import numpy as np

from ...arrays import number as checked_number
from ...certificate import Certificate
from ...errors import DimensionError, InvalidInputError
from ...inc import INC
from ...sets import Box
from . import counting
from .header import header_text
from .plan import planned
from .precision import precise, within, written
from .program import program, state
from .sizes import output_error
from .source import CSource
from .stack import stack

METHODS = ("auto", "one pass", "contraction", "newton", "splitting")
KEYWORDS = frozenset("auto break case char const continue default do double else enum extern float for goto if inline int "
                     "long main register restrict return short signed sizeof static struct switch typedef union unsigned "
                     "void volatile while tanh tanhf pattern".split())


def to_c(inc: INC, name: str = "inc", *, method: str = "auto", tol: float | None = None, cache: bool = False,
         inputs: Box | None = None, limits: Box | None = None, certificate: Certificate | None = None,
         precision: str = "double") -> CSource:
    """Return the law u = inc(y) as two files of C99 that allocate nothing and need nothing but, for curved units, tanh.

    The function is `int name(const double y[p], double u[m])`, or with a cache `int name(name_state *state, ...)` with a
    state that starts as zeros. Layers are evaluated in one pass. A loop, a strongly connected component of the graph of
    W, is solved to the tolerance `tol` relative to max(1, its drive), 1e-13 when left out, by

    * "contraction": steps eta -> phi(W eta + c), where Perron-Frobenius holds (`loops.contracting`);
    * "newton": Newton's trials on the affine pieces, each taken only if it shrinks the residual as a step would, else such a
      step; where only a multiplier holds, trials judged by their residual and then splitting (`split_loops.splitting`);
    * "splitting": where only a multiplier holds, without trials;
    * "auto": whichever took less work on sampled measurements; the proof does not rest on that.

    The number of steps that is promised rises as tol falls and, for W = kappa W0, as kappa rises, except where "auto"
    changes the method and where a contraction ends and a multiplier begins (`plan` says why).

    The function returns how many evaluations of loops it took, and a negative number when the residual of a loop under a
    multiplier missed its tolerance. A y with a NaN or an infinity gives a NaN in every output and 0, and leaves the state
    as it was; beyond reach, where numbers may overflow, u may be anything, but the steps and the memory stay as promised.

    name: a C identifier; "one pass": refuses loops; cache: keeps the last pattern and its factors in the state, and tries
    it first; inputs: the Box of y for which the error bound is stated, R^p when left out; limits: a Box in R^m to which u
    is clipped at the end; certificate: its sentence and digest go into the header; precision: "float" writes everything in
    single precision (y and u too, tol 1e-5 when left out, limits rounded inwards), with a bound on its error by the same
    analysis, unit roundoff 2^-24 and the rounding of the coefficients included.

    Raises InvalidInputError for a method that does not fit, a name C does not allow, or a curved activation without a C
    formula; NotWellPosedError for a loop without proof; DimensionError for boxes of other dimensions.

    >>> source = to_c(INC([[0.5]], [[1.0]], [[-1.0]], [[0.0]]), inputs=Box([-1.0], [1.0]), method="contraction")
    >>> source.iterations, source.error_bound < 1e-12
    (45, True)
    """
    _refuse(inc, name, method, inputs, limits)
    kind = precise(precision)
    tol = checked_number("tol", kind.tol if tol is None else tol, kind.finest, 1e-2)
    clips, moved = within(limits, kind)
    with np.errstate(over="ignore", invalid="ignore"):  # refused in the next lines
        plan = planned(inc, method, tol, cache, inputs, clips, kind)
        error, largest = output_error(plan.law, plan.sizes)
        error[:, 0] += moved
    if not (np.all(np.isfinite(error)) and largest[0] <= kind.huge):
        raise InvalidInputError(f"the law forms numbers up to {largest[0]:.3g}, which {kind.word}s do not hold")
    reach = (kind.huge - largest[0]) / max(largest[1], 1.0) if inputs is None else float(np.max(plan.sizes.y[:, 0]))
    work = counting.affine_work(plan.law, plan.stages)
    for stage, loop in zip(plan.stages, plan.loops, strict=True):
        if loop is not None:
            work = work.plus(counting.loop_work(plan.law, stage, loop, cache))
    solved = [loop for loop in plan.loops if loop is not None]
    text = written(program(plan, name), kind)
    if any(re.match(rf"static .*\b{name}\b[\[(]", line) for line in text):
        raise InvalidInputError(f"name = {name!r} is the name of something else in the same C file: take another")
    found = CSource(name, "", "\n".join(text) + "\n", inputs, float(error[:, 0].max()), float(error[:, 1].max()),
                    float(reach), sum(loop.evaluations for loop in solved), work.operations, work.curved, _numbers(text),
                    tuple(dict.fromkeys(loop.method for loop in solved)), stack(text, name), kind.word)
    return header_text(found, inc, (limits, clips), certificate, state(plan, name), kind)


def _refuse(inc: INC, name: str, method: str, inputs: Box | None, limits: Box | None) -> None:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or name in KEYWORDS:
        raise InvalidInputError(f"name = {name!r} is no name for a C function: letters, digits, underscores, no word of C")
    if method not in METHODS:
        raise InvalidInputError(f"method is {method!r}, but must be one of {', '.join(map(repr, METHODS))}")
    for what, box, size in (("inputs", inputs, inc.p), ("limits", limits, inc.m)):
        if box is not None and box.dimension != size:
            raise DimensionError(f"{what} is a box in R^{box.dimension}, but the law needs one in R^{size}")


def _numbers(text: list[str]) -> int:
    return sum(int(size) for size in re.findall(r"static const (?:double|float) \w+\[(\d+)\]", "\n".join(text)))
