"""Values as JSON content and back: numbers bit for bit, arrays with their shape, dataclasses field by field."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from fractions import Fraction
from math import isfinite
from typing import Any

import numpy as np

from ..arrays import frozen
from ..errors import FormatError, INCError
from .field_types import check_fields
from .kinds import ADDED, BESIDE, KINDS, MAKERS, STAND_INS

ENTRIES: dict[str, type | tuple[type, ...]] = {"float": (int, float), "int": int, "bool": bool, "fraction": str}
"""What arrays may be of, and the JSON type of their entries; "float" is left unsaid."""

_NOT_FINITE = {"nan": np.nan, "inf": np.inf, "-inf": -np.inf}
_REFUSALS = (INCError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)  # of a constructor, to odd data


def canonical(content: Any) -> str:
    """Return JSON content in canonical form: keys sorted, no spaces, numbers as `repr` writes them.

    Raises ValueError for a number that is not finite.

    >>> canonical({"b": 1.0, "a": [1]})
    '{"a":[1],"b":1.0}'
    """
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def digest(content: Any) -> str:
    """Return the SHA-256 of JSON content in canonical form.

    Raises ValueError for a number that is not finite.

    >>> digest({"b": 1.0, "a": [1]}) == digest({"a": [1], "b": 1.0}) != digest({"a": [1], "b": 1})
    True
    """
    return hashlib.sha256(canonical(content).encode("ascii")).hexdigest()


def encoded(value: Any) -> Any:
    """Return a value as JSON content: what is None, a number, text, an array, a tuple, a mapping or one of `KINDS`.

    Raises FormatError for anything else.

    >>> encoded(np.array([[1.0]])), encoded((Fraction(1, 3), np.inf))
    ({'array': [1.0], 'shape': [1, 1]}, [{'fraction': '1/3'}, {'number': 'inf'}])
    """
    if type(value) in STAND_INS:
        value = STAND_INS[type(value)](value)
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.ndarray):
        return _encoded_array(value)
    if isinstance(value, np.generic):
        return encoded(value.item())
    if isinstance(value, int | float):
        return value if isfinite(value) else {"number": str(float(value))}
    if isinstance(value, Fraction):
        return {"fraction": str(value)}
    if isinstance(value, tuple | list):
        return [encoded(entry) for entry in value]
    if isinstance(value, Mapping):
        return {"map": {str(key): encoded(entry) for key, entry in value.items()}}
    if type(value) in KINDS:
        data = {field.name: encoded(getattr(value, field.name)) for field in fields(value) if field.init}
        data |= {name: encoded(vars(value)[name]) for name in BESIDE.get(type(value), ()) if name in vars(value)}
        return {"kind": type(value).__name__, "data": data}
    raise FormatError(f"{type(value).__name__} cannot be saved")


def _encoded_array(array: np.ndarray) -> dict[str, Any]:
    names = {"f": "float", "i": "int", "b": "bool", "O": "fraction"}
    name = names.get(array.dtype.kind)
    entries = array.ravel().tolist()
    if name is None or (name == "fraction" and not all(isinstance(entry, Fraction) for entry in entries)):
        raise FormatError(f"an array of {array.dtype} cannot be saved")
    if name == "float" and not np.all(np.isfinite(array)):
        raise FormatError("an array with a NaN or an infinity cannot be saved")
    content = {"array": [str(entry) for entry in entries] if name == "fraction" else entries, "shape": list(array.shape)}
    return content if name == "float" else content | {"of": name}


def decoded(value: Any, where: str) -> Any:
    """Return what `encoded` was given: lists as tuples, arrays read-only, equal nouns as one object.

    Nouns do not change, so one object may stand wherever the file says the same; cells that name the distribution that
    they divide, say, then name that very object.

    where: the place of the content, for messages.
    Raises FormatError for content that no value has, and for what a constructor refuses.

    >>> decoded([1.5, {"number": "inf"}], "here")
    (1.5, inf)
    """
    return _Reader().read(value, where)


class _Reader:
    def __init__(self) -> None:
        self.made: dict[str, Any] = {}

    def read(self, value: Any, where: str) -> Any:
        if value is None or isinstance(value, bool | str | int | float):
            return value
        if isinstance(value, list):
            return tuple(self.read(entry, where) for entry in value)
        keys = set(value)
        if {"array", "shape"} <= keys <= {"array", "shape", "of"}:
            return _array(value["array"], value["shape"], value.get("of", "float"), where)
        if keys in ({"number"}, {"fraction"}):
            return _number(value, where)
        if keys == {"map"} and isinstance(value["map"], dict):
            return {key: self.read(entry, f"{where}: {key}") for key, entry in value["map"].items()}
        if keys == {"kind", "data"} and isinstance(value["data"], dict):
            return self._once(value, where)
        raise FormatError(f"{where} holds an entry with the keys [{', '.join(sorted(value))}], which no value has")

    def _once(self, value: dict[str, Any], where: str) -> Any:
        name = digest(value)
        if name not in self.made:
            self.made[name] = self._noun(value["kind"], value["data"], where)
        return self.made[name]

    def _noun(self, kind: Any, data: dict[str, Any], where: str) -> Any:
        found = [known for known in KINDS if known.__name__ == kind]
        if not found:
            raise FormatError(f"{where} holds a {kind!r}, which this version does not know")
        wanted = {field.name for field in fields(found[0]) if field.init}
        wanted -= ADDED.get(found[0], set()) - set(data)
        wanted |= BESIDE.get(found[0], set()) & set(data)
        if wanted != set(data):
            missing, extra = sorted(wanted - set(data)), sorted(set(data) - wanted)
            raise FormatError(f"{where}: {kind} lacks {missing} and has {extra} that it should not")
        parts = {name: self.read(value, f"{where}: {name}") for name, value in data.items()}
        try:
            check_fields(found[0], parts)
            return MAKERS.get(found[0], found[0])(**parts)
        except _REFUSALS as error:
            raise FormatError(f"{where}: {kind} refuses its data: {error}") from error


def _array(entries: Any, shape: Any, name: Any, where: str) -> np.ndarray:
    if not isinstance(name, str) or name not in ENTRIES:
        raise FormatError(f"{where} holds an array of {name!r}, which this version does not know")
    sizes = isinstance(shape, list) and all(type(size) is int and size >= 0 for size in shape)
    kinds = ENTRIES[name]
    numbers = isinstance(entries, list) and all(type(entry) in (kinds if isinstance(kinds, tuple) else (kinds,))
                                                for entry in entries)
    if not (numbers and sizes and len(entries) == int(np.prod(shape, dtype=int))):
        raise FormatError(f"{where} holds an array whose entries are not numbers or do not fill its shape {shape}")
    if name == "fraction":
        array = np.empty(len(entries), dtype=object)
        array[:] = [_number({"fraction": entry}, where) for entry in entries]
    else:
        array = np.array(entries, dtype={"float": float, "int": int, "bool": bool}[name])
    return frozen(array.reshape(shape))


def _number(value: dict[str, Any], where: str) -> Any:
    try:
        return _NOT_FINITE[value["number"]] if "number" in value else Fraction(value["fraction"])
    except (LookupError, TypeError, ValueError, ZeroDivisionError) as error:
        raise FormatError(f"{where} holds {value}, which is no number") from error
