"""Save what the toolbox knows to JSON and read it back, re-validated by the constructors.

A file is {"format": "inc_casadi", "version": 2, "digest": ..., "kind": ..., "data": {field: value}}. Numbers are written
with `repr`, so every double comes back bit for bit, and a certificate proves tomorrow what it proved today. What a file may
hold stands in `kinds`; kinds are added without a new version, for what was written before is read as before.

The digest is the SHA-256 of kind and data in canonical JSON (keys sorted, no spaces). It finds what went wrong by accident:
a damaged copy, a number edited by hand and forgotten. It is not a signature: whoever alters a file on purpose can also
compute its digest anew. Against that stands only what a certificate proves from the numbers it holds, so read its
sentence and the plant in it, not the name of the file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..errors import FormatError
from .encoding import decoded, digest, encoded
from .kinds import ADDED, KINDS

__all__ = ["ADDED", "FORMAT", "KINDS", "VERSION", "digest", "load", "save"]

FORMAT, VERSION = "inc_casadi", 2
HEADER = ("format", "version", "digest")


def save(noun: Any, path: str | Path) -> None:
    """Write a noun, a claim, a certificate, a bound or a comparison, or a mapping from names to such, to a JSON file.

    Of a comparison with a function among its controllers the function's name is kept, for no file can hold the function.

    Raises FormatError for an object, or a part of one, that is not of a kind in `KINDS`.

    >>> import tempfile
    >>> from inc_casadi import Plant
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save(Plant([[0.1]], [[1.0]]), Path(folder) / "plant.json")
    ...     load(Path(folder) / "plant.json").A.tolist()
    [[0.1]]
    """
    if type(noun) not in KINDS and not isinstance(noun, Mapping):
        known = ", ".join(kind.__name__ for kind in KINDS)
        raise FormatError(f"{type(noun).__name__} cannot be saved: it is not one of {known}")
    try:
        content = encoded(noun)
        header = {"format": FORMAT, "version": VERSION, "digest": digest(content)}
        text = json.dumps(header | content, indent=1, allow_nan=False)
    except FormatError as error:
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
    return decoded(held, str(path))


def _refuse_alteration(held: dict[str, Any], stated: Any, where: str) -> None:
    try:
        found = digest(held)
    except ValueError as error:
        raise FormatError(f"{where} holds a number that is not finite: {error}") from error
    if stated != found:
        raise FormatError(f"{where} was altered after it was saved: its digest is {stated!r}, but its content has {found!r}")


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not a finite number")
