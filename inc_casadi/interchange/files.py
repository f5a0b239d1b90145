"""Save what the toolbox knows to JSON and read it back, re-validated by the constructors.

A file is {"format": "inc_casadi", "version": 2, "digest": ..., "kind": ..., "data": {field: value}}. Numbers are written
with `repr`, so every double comes back bit for bit, and a certificate proves tomorrow what it proved today.

The digest is the SHA-256 of kind and data in canonical JSON (keys sorted, no spaces). It finds what went wrong by accident:
a damaged copy, a number edited by hand and forgotten. It is not a signature: whoever alters a file on purpose can also
compute its digest anew. Against that stands only what a certificate proves from the numbers it holds, so read its
sentence and the plant in it, not the name of the file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..activations import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh, TwoSlopes
from ..certificate import MatrixCertificate
from ..claims import (
    Attraction,
    DeviationCost,
    DiscountedCost,
    Invariance,
    L2Gain,
    Margins,
    Polytopic,
    Regional,
    Robust,
    Stability,
    Together,
)
from ..ellipsoid_certificate import EllipsoidCertificate
from ..errors import FormatError, INCError
from ..inc import INC
from ..invariance_certificate import InvarianceCertificate
from ..multipliers import Lifted, Relu, Sector, Slope
from ..pieces.conewise_tail import ConewiseProof
from ..pieces.walk import Budget
from ..plant import Plant
from ..regional_certificate import RegionalCertificate
from ..sets import Box, Ellipsoid, Empirical, Gaussian, Polytope, Uniform
from ..spec import Spec
from ..uncertainty import InputSector, NormBounded

FORMAT, VERSION = "inc_casadi", 2
HEADER = ("format", "version", "digest")

KINDS: tuple[type, ...] = (
    Plant, INC, Spec, Box, Polytope, Ellipsoid, Uniform, Gaussian, Empirical, Stability, DiscountedCost, DeviationCost,
    L2Gain, Margins, Robust, Polytopic, Together, Regional, Attraction, Invariance, InputSector, NormBounded, Sector, Slope,
    Relu, Lifted, MatrixCertificate, RegionalCertificate, EllipsoidCertificate, InvarianceCertificate, Budget,
    CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh, TwoSlopes, ConewiseProof,
)
"""The dataclasses that a file may hold, each written field by field under its class's name; add a class to save it."""

ADDED: dict[type, set[str]] = {RegionalCertificate: {"conewise"}}
"""Fields that files of this version were once written without: where they are missing, they have their default."""


def save(noun: Any, path: str | Path) -> None:
    """Write a noun, a claim or a certificate, or a mapping from names to such, to a JSON file.

    Raises FormatError for an object, or a part of one, that is not of a kind in `KINDS`.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(Plant([[0.1]], [[1.0]]), Path(folder) / "plant.json")
    ...     load(Path(folder) / "plant.json").A.tolist()
    [[0.1]]
    """
    if type(noun) not in KINDS and not isinstance(noun, Mapping):
        known = ", ".join(kind.__name__ for kind in KINDS)
        raise FormatError(f"{type(noun).__name__} cannot be saved: it is not one of {known}")
    try:
        content = _encoded(noun)
        header = {"format": FORMAT, "version": VERSION, "digest": digest(content)}
        text = json.dumps(header | content, indent=1, allow_nan=False)
    except ValueError as error:
        raise FormatError(f"{type(noun).__name__} cannot be saved: {error}") from error
    Path(path).write_text(text + "\n", encoding="utf-8")


def load(path: str | Path) -> Any:
    """Return what `save` wrote.

    Raises FormatError when the file is not such a file, is of another version, was altered, has missing or unknown
    entries, or holds values that the constructor refuses; OSError when it cannot be read.
    """
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except ValueError as error:
        raise FormatError(f"{path} is not a JSON file of this toolbox: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise FormatError(f"{path} is not a file of this toolbox: its format is not {FORMAT!r}")
    if content.get("version") != VERSION or type(content["version"]) is not int:
        raise FormatError(f"{path} has version {content.get('version')!r}, but this toolbox reads version {VERSION}")
    held = {key: value for key, value in content.items() if key not in HEADER}
    _refuse_alteration(held, content.get("digest"), str(path))
    return _decoded(held, str(path))


def digest(content: Any) -> str:
    """Return the SHA-256 of JSON content in canonical form: keys sorted, no spaces, numbers as `repr` writes them.

    Raises ValueError for a number that is not finite.

    >>> digest({"b": 1.0, "a": [1]}) == digest({"a": [1], "b": 1.0}) != digest({"a": [1], "b": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _refuse_alteration(held: dict[str, Any], stated: Any, where: str) -> None:
    try:
        found = digest(held)
    except ValueError as error:
        raise FormatError(f"{where} holds a number that is not finite: {error}") from error
    if stated != found:
        raise FormatError(f"{where} was altered after it was saved: its digest is {stated!r}, but its content has {found!r}")


def _encoded(value: Any) -> Any:
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.ndarray):
        return {"array": [_encoded(entry) for entry in value.ravel().tolist()], "shape": list(value.shape)}
    if isinstance(value, int | float | np.number):
        return value.item() if isinstance(value, np.number) else value
    if isinstance(value, tuple | list):
        return [_encoded(entry) for entry in value]
    if isinstance(value, Mapping):
        return {"map": {str(key): _encoded(entry) for key, entry in value.items()}}
    if type(value) in KINDS:
        data = {field.name: _encoded(getattr(value, field.name)) for field in fields(value) if field.init}
        return {"kind": type(value).__name__, "data": data}
    raise FormatError(f"{type(value).__name__} cannot be saved")


def _decoded(value: Any, where: str) -> Any:
    if value is None or isinstance(value, bool | str | int | float):
        return value
    if isinstance(value, list):
        return tuple(_decoded(entry, where) for entry in value)
    if set(value) == {"array", "shape"}:
        return _array(value["array"], value["shape"], where)
    if set(value) == {"map"} and isinstance(value["map"], dict):
        return {key: _decoded(entry, f"{where}: {key}") for key, entry in value["map"].items()}
    if set(value) == {"kind", "data"} and isinstance(value["data"], dict):
        return _noun(value["kind"], value["data"], where)
    raise FormatError(f"{where} holds an entry with the keys [{', '.join(sorted(value))}], which no value has")


def _array(entries: Any, shape: Any, where: str) -> np.ndarray:
    numbers = isinstance(entries, list) and all(type(entry) in (int, float) for entry in entries)
    sizes = isinstance(shape, list) and all(type(size) is int and size >= 0 for size in shape)
    if not (numbers and sizes and len(entries) == int(np.prod(shape, dtype=int))):
        raise FormatError(f"{where} holds an array whose entries are not numbers or do not fill its shape {shape}")
    return np.array(entries, dtype=float).reshape(shape)


def _noun(kind: Any, data: dict[str, Any], where: str) -> Any:
    found = [known for known in KINDS if known.__name__ == kind]
    if not found:
        raise FormatError(f"{where} holds a {kind!r}, which this version does not know")
    wanted = {field.name for field in fields(found[0]) if field.init}
    wanted -= ADDED.get(found[0], set()) - set(data)
    if wanted != set(data):
        missing, extra = sorted(wanted - set(data)), sorted(set(data) - wanted)
        raise FormatError(f"{where}: {kind} lacks {missing} and has {extra} that it should not")
    parts = {name: _decoded(value, f"{where}: {name}") for name, value in data.items()}
    try:
        return found[0](**parts)
    except (INCError, TypeError, AttributeError) as error:
        raise FormatError(f"{where}: {kind} refuses its data: {error}") from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not a finite number")
