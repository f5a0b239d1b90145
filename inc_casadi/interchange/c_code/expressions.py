"""An activation as a C expression: from its affine pieces, or, where it is curved, from a table of formulas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...activations import Activation, CenteredLogistic, Logistic, Tanh
from ...errors import InvalidInputError

CURVED_ROUNDING = 16.0  # in eps: the formulas below from a tanh that errs by at most 4 units in the last place


@dataclass(frozen=True)
class Curve:
    """C expressions of phi(z) and, from its value f, of phi'(z); {z} and {f} stand for them."""

    value: str
    slope: str


CURVES: dict[type[Activation], Curve] = {
    Tanh: Curve("tanh({z})", "1.0 - {f} * {f}"),
    Logistic: Curve("0.5 + 0.5 * tanh(0.5 * {z})", "{f} * (1.0 - {f})"),
    CenteredLogistic: Curve("0.5 * tanh(0.5 * {z})", "0.25 - {f} * {f}"),
}
"""The curved activations that C code is written for, each bounded by 1; a class not in it has to have pieces."""


def curve(unit: Activation) -> Curve | None:
    """Return the formulas of a curved activation, None for one with affine pieces.

    Raises InvalidInputError for a curved one without a formula here.

    >>> from inc_casadi import ReLU
    >>> curve(Tanh()).value, curve(ReLU())
    ('tanh({z})', None)
    """
    if unit.pieces is not None:
        return None
    if type(unit) not in CURVES:
        known = ", ".join(sorted(kind.__name__ for kind in CURVES))
        raise InvalidInputError(f"{type(unit).__name__} has no affine pieces and no C formula: C code knows {known} and "
                                "every piecewise-affine activation")
    return CURVES[type(unit)]


def value(unit: Activation, z: str) -> str:
    """Return phi(z) in C; a NaN stays one.

    >>> from inc_casadi import ReLU, Saturation
    >>> value(ReLU(), "z"), value(Saturation(), "z")
    ('z < 0.0 ? 0.0 : z', 'z < -1.0 ? -1.0 : z < 1.0 ? z : 1.0')
    """
    bent = curve(unit)
    if bent is not None:
        return bent.value.format(z=z)
    pieces = unit.pieces
    assert pieces is not None
    return _chain(z, pieces.kinks, [line(z, s, c) for s, c in zip(pieces.slopes, pieces.intercepts, strict=True)])


def slope(unit: Activation, z: str, f: str) -> str:
    """Return phi'(z) in C, at a kink the slope on its right; f names the value phi(z).

    >>> from inc_casadi import ReLU
    >>> slope(ReLU(), "z", "f"), slope(Tanh(), "z", "f")
    ('z < 0.0 ? 0.0 : 1.0', '1.0 - f * f')
    """
    bent = curve(unit)
    if bent is not None:
        return bent.slope.format(f=f)
    pieces = unit.pieces
    assert pieces is not None
    return _chain(z, pieces.kinks, [number(s) for s in pieces.slopes])


def _chain(z: str, kinks: np.ndarray, parts: list[str]) -> str:
    tests = [f"{z} < {number(kink)} ? {part} : " for kink, part in zip(kinks, parts, strict=False)]
    return "".join(tests) + parts[-1]


def line(z: str, rise: float, offset: float) -> str:
    """Return rise z + offset in C, without the parts that do nothing.

    >>> line("z", 1.0, 0.0), line("z", 0.0, 2.0), line("z", 0.5, -1.0)
    ('z', '2.0', '0.5 * z + -1.0')
    """
    if rise == 0.0:
        return number(offset)
    product = z if rise == 1.0 else f"{number(rise)} * {z}"
    return product if offset == 0.0 else f"{product} + {number(offset)}"


def number(value: float) -> str:
    """Return a double as C reads it back bit for bit: short decimals as they are, all others in hexadecimal.

    >>> number(0.5), number(-0.0), number(0.1)
    ('0.5', '0.0', '0x1.999999999999ap-4')
    """
    value = float(value) + 0.0
    text = repr(value)
    exact = value == round(value * 1024) / 1024 and abs(value) < 2**20
    return text if exact and "e" not in text else value.hex()


def rounding(unit: Activation, size: np.ndarray, eps: float) -> np.ndarray:
    """Return how far phi(z) as computed by `value` may be from phi(z), for |z| <= size.

    A piece takes two roundings, of slope z and of the sum; a curved one is bounded by 1 (`CURVED_ROUNDING`).

    >>> from inc_casadi import ReLU
    >>> rounding(ReLU(), np.ones(1), 2.0**-52).item() < 1e-15
    True
    """
    if curve(unit) is not None:
        return np.full(size.shape, CURVED_ROUNDING * eps)
    pieces = unit.pieces
    assert pieces is not None
    return 4 * eps * (np.max(np.abs(pieces.slopes)) * size + np.max(np.abs(pieces.intercepts)))
