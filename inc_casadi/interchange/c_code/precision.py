"""The floats that the C of a law works in, and the text of a source in double precision translated to single precision."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...arrays import Array
from ...errors import InvalidInputError
from ...inc import INC
from ...sets import Box
from .expressions import number


@dataclass(frozen=True)
class Precision:
    """word: the C type, of so many bytes; eps: twice its unit roundoff; tiny: more than one operation loses to underflow,
    flushed to zero or not; huge: what must not be exceeded; finest, tol: the least and the usual tolerance of loops;
    smallest: of a coefficient that is not zero."""

    word: str
    bytes: int
    eps: float
    tiny: float
    huge: float
    finest: float
    tol: float
    smallest: float


DOUBLE = Precision("double", 8, 2.0**-52, 1e-300, 1e300, 2.0**-50, 1e-13, 0.0)
SINGLE = Precision("float", 4, 2.0**-23, 1e-37, 1e36, 2.0**-21, 1e-5, 1e-30)
PRECISIONS = {"double": DOUBLE, "float": SINGLE}

LITERAL = re.compile(r"(?<![\w.])(0x[0-9a-f](?:\.[0-9a-f]+)?p[+-]?\d+|\d+\.\d+(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])")


def precise(word: str) -> Precision:
    """Return the precision "double" or "float".

    Raises InvalidInputError for another word.

    >>> precise("float").eps == 2.0**-23
    True
    """
    if word not in PRECISIONS:
        raise InvalidInputError(f"precision is {word!r}, but must be 'double' or 'float'")
    return PRECISIONS[word]


def written(lines: Iterable[str], precision: Precision) -> list[str]:
    """Return C in the precision wanted: types, calls of tanh, and each constant rounded to the nearest float.

    >>> written(["double z = 0x1.999999999999ap-4 * tanh(y[0]) + 1.0;"], SINGLE)
    ['float z = 0x1.99999a0000000p-4f * tanhf(y[0]) + 1.0f;']
    """
    if precision is DOUBLE:
        return list(lines)
    return [_single(line) for line in lines]


def _single(line: str) -> str:
    line = LITERAL.sub(_literal, line)
    return re.sub(r"\btanh\(", "tanhf(", re.sub(r"\bdouble\b", "float", line))


def _literal(found: re.Match[str]) -> str:
    text = found.group(1)
    value = float.fromhex(text) if text.startswith("0x") else float(text)
    return number(float(np.float32(min(value, SINGLE.huge)))) + "f"


def check_coefficients(law: INC, weights: Iterable[Array], precision: Precision) -> None:
    """Refuse a law whose coefficients single precision holds only with a large relative error, or not at all.

    Raises InvalidInputError that names the coefficient.
    """
    pieces = [part for unit in law.activations if unit.pieces is not None
              for part in (unit.pieces.slopes, unit.pieces.intercepts, unit.pieces.kinks)]
    for part in (law.W, law.U, law.V, law.K, law.b, law.d, *pieces, *weights):
        size = np.abs(part[part != 0])
        odd = size[(size < precision.smallest) | (size > precision.huge)]
        if odd.size:
            raise InvalidInputError(f"the law has a coefficient of size {odd[0]:.3g}, but single precision is written for "
                                    f"coefficients between {precision.smallest:g} and {precision.huge:g}, or zero")


def within(limits: Box | None, precision: Precision) -> tuple[Box | None, Array | float]:
    """Return the largest box of the precision's floats within a box of limits, and by how much its ends (m,) are moved.

    Raises InvalidInputError where two ends have no two floats between them.

    >>> box, moved = within(Box([-0.1], [0.1]), SINGLE)
    >>> box.upper.item() <= 0.1, moved.item() < 1e-8
    (True, True)
    """
    if limits is None or precision is DOUBLE:
        return limits, 0.0
    lower, upper = limits.lower.astype(np.float32), limits.upper.astype(np.float32)
    lower = np.where(lower < limits.lower, np.nextafter(lower, np.float32(np.inf)), lower).astype(float)
    upper = np.where(upper > limits.upper, np.nextafter(upper, np.float32(-np.inf)), upper).astype(float)
    if np.any(lower >= upper):
        raise InvalidInputError("between two limits lies no interval of single precision")
    return Box(lower, upper), np.maximum(lower - limits.lower, limits.upper - upper)
