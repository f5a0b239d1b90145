"""Tables of the other commands kept as JSON, so that the results page can show them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inc_casadi.errors import FormatError

from .environment import environment
from .files import slug
from .record import Environment

SHEETS = "sheets"
ORDER = ("paper", "bounds", "main", "speed")


@dataclass(frozen=True)
class Sheet:
    """A table that a command printed. title: the command's words; text: as it was printed; environment: of the run."""

    title: str
    text: str
    environment: Environment


def write_sheet(folder: Path, title: str, text: str, rows: Sequence[Any] = ()) -> Path:
    """Write what `python -m benchmarks <title>` printed, with its rows as plain values, and return the path.

    rows : dataclasses of figures, or nothing; they are for other programs, the page shows `text`
    """
    place = folder / SHEETS
    place.mkdir(parents=True, exist_ok=True)
    path = place / f"{slug(title)}.json"
    content = {"title": title, "environment": asdict(environment()), "rows": [_plain(row) for row in rows], "text": text}
    path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return path


def read_sheets(folder: Path) -> list[Sheet]:
    """Return the tables kept in a folder, the paper's first; none when there are none.

    Raises FormatError when a file is no such table.
    """
    found = [_read(path) for path in sorted((folder / SHEETS).glob("*.json"))]
    place = {name: index for index, name in enumerate(ORDER)}
    return sorted(found, key=lambda one: (place.get(one.title.split()[0], len(ORDER)), one.title))


def _read(path: Path) -> Sheet:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return Sheet(content["title"], content["text"], Environment(**content["environment"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{path} holds no table of this toolbox: {error!r}") from error


def _plain(row: Any) -> Any:
    """A row as plain values; what is not finite, or no plain value, is None or its text."""
    if is_dataclass(row) and not isinstance(row, type):
        return {key: _plain(value) for key, value in asdict(row).items()}
    if isinstance(row, dict):
        return {str(key): _plain(value) for key, value in row.items()}
    if isinstance(row, list | tuple | np.ndarray):
        return [_plain(value) for value in row]
    if row is None or isinstance(row, str | bool | int):
        return row
    if isinstance(row, float | np.floating | np.integer):
        return float(row) if np.isfinite(row) else None
    return str(row)
