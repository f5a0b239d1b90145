"""Whether what a file says of a dataclass is of the types that its fields state, where no constructor looks."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np

from ..errors import InvalidInputError


def check_fields(kind: type, parts: Mapping[str, Any]) -> None:
    """Refuse values that are not of the stated types, for a dataclass whose constructor checks nothing itself.

    Shapes and signs are left to what recomputes a verdict from the values; it may rely on the types.

    Raises InvalidInputError naming the field.

    >>> from inc_casadi.certificate import Proof
    >>> check_fields(Proof, {"succeeded": True, "method": "magic", "seconds": "none"})
    Traceback (most recent call last):
        ...
    inc_casadi.errors.InvalidInputError: seconds is 'none', but must be of type float
    """
    if hasattr(kind, "__post_init__"):
        return
    hints = _hints(kind)
    for field in fields(kind):
        if field.name in parts and not fits(parts[field.name], hints[field.name]):
            shown = getattr(hints[field.name], "__name__", str(hints[field.name]))
            raise InvalidInputError(f"{field.name} is {parts[field.name]!r}, but must be of type {shown}")


def fits(value: Any, hint: Any) -> bool:
    """Return whether a value is of a type as an annotation states it; what the annotation leaves open passes.

    >>> fits((1.0, 2), tuple[float, ...]), fits(None, float | None), fits("1", float), fits(True, int)
    (True, True, False, False)
    """
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any or isinstance(hint, typing.TypeVar) or hint is object:
        return True
    if origin in (typing.Union, types.UnionType):
        return any(fits(value, one) for one in arguments)
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if origin is tuple:
        return isinstance(value, tuple) and _tuple_fits(value, arguments)
    if origin is np.ndarray:
        return isinstance(value, np.ndarray)
    if isinstance(origin, type):  # Mapping[str, float] and the like: what is inside is looked at by whoever reads it
        return isinstance(value, origin)
    if getattr(hint, "_is_protocol", False):
        return all(hasattr(value, name) for name in _methods(hint))
    return not isinstance(hint, type) or isinstance(value, hint)


def _tuple_fits(value: tuple[Any, ...], arguments: tuple[Any, ...]) -> bool:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        return all(fits(entry, arguments[0]) for entry in value)
    return len(value) == len(arguments) and all(map(fits, value, arguments))


def _methods(protocol: type) -> list[str]:
    return [name for name, member in vars(protocol).items() if callable(member) and not name.startswith("_")]


@cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)
