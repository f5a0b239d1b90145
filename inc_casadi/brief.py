"""Print a noun in a line: small arrays in full, large ones by their shape, what is nested by its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

ENTRIES, LETTERS = 6, 72  # an array up to so many entries, anything else up to so many letters, is shown in full


class Brief:
    """A noun whose repr is one line, however large its arrays are; `print` keeps a `__str__` that the noun has.

    Dataclasses write a repr of their own over an inherited one. So each subclass is given, as it is made, the one that it
    inherits, and `@dataclass` leaves that in place. A field with repr=False is not shown, nor one that is None or empty.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False)
    ... class Pair(Brief):
    ...     gain: object
    ...     data: object
    ...     note: str = ""
    >>> Pair(np.array([[0.5, 2.0]]), np.zeros((3, 40)))
    Pair(gain=[[0.5, 2]], data=<3 x 40 array>)
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        setattr(cls, "__repr__", cls.__repr__)  # noqa: B010  # a plain assignment to a dunder is no method to mypy

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(_fields(self))})"


def shown(value: Any) -> str:
    """Return a value as a noun's repr shows it.

    >>> shown(np.eye(2)), shown(np.zeros(40)), shown(0.1 + 0.2), shown({"P": np.eye(9)}), shown([1.0] * 30)
    ('[[1, 0], [0, 1]]', '<40 array>', '0.3', '<P>', '<30 of float>')
    """
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return f"<{_cut(', '.join(map(str, value)), LETTERS)}>"
    if isinstance(value, tuple | list):
        return _sequence(value)
    text = repr(value)
    if len(text) <= LETTERS:
        return text
    return _cut(text, LETTERS) if isinstance(value, str) else f"<{type(value).__name__}>"


def _fields(noun: Any) -> list[str]:
    named = [(one.name, getattr(noun, one.name)) for one in (fields(noun) if is_dataclass(noun) else ()) if one.repr]
    return [f"{name}={shown(value)}" for name, value in named if not _says_nothing(value)]


def _says_nothing(value: Any) -> bool:
    return value is None or isinstance(value, str | tuple) and not value


def _array(value: np.ndarray) -> str:
    if value.size > ENTRIES or not np.issubdtype(value.dtype, np.number):
        return f"<{' x '.join(map(str, value.shape))} array>"
    return _nested(value.tolist())


def _nested(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_nested, value))}]"
    return f"{value:.6g}"


def _sequence(value: tuple[Any, ...] | list[Any]) -> str:
    parts = [shown(one) for one in value[:ENTRIES + 1]]
    text = ", ".join(parts)
    if len(value) <= ENTRIES and len(text) <= LETTERS and not any(part.startswith("<") for part in parts):
        return f"[{text}]" if isinstance(value, list) else f"({text}{',' if len(value) == 1 else ''})"
    kinds = sorted({type(one).__name__ for one in value})
    return f"<{len(value)} of {_cut(', '.join(kinds), LETTERS)}>"


def _cut(text: str, length: int) -> str:
    return text if len(text) <= length else text[: length - 3] + "..."
