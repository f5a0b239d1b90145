"""Records on disk: one JSON file per plant as soon as it is known, all of them in one, and a CSV table."""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from inc_casadi.errors import FormatError

from .record import Entry, PlantRecord, from_plain, to_plain

LAWS = (".law.json", ".memory.json")
PLANTS, ALL, TABLE = "plants", "results.json", "results.csv"
OF_PLANT = ("plant", "n", "m", "p", "source", "any", "linear", "static", "seed", "commit", "date", "failure")
STAGES = ("synthesis", "synthesis with memory", "designs", "judging", "bounds", "growth", "evaluation", "in all")
COLUMNS = (*OF_PLANT, *(f"s, {stage}" for stage in STAGES), *(one.name for one in fields(Entry)))


def slug(name: str) -> str:
    """Return the name of a plant as the stem of a file.

    >>> slug("two lags, output")
    'two-lags-output'
    """
    return re.sub(r"[^0-9A-Za-z]+", "-", name).strip("-")


def write_record(folder: Path, record: PlantRecord, law: str = "", memory: str = "") -> Path:
    """Write the record of a plant and return its path; beside it the files of its synthesized laws, static and with memory.
    """
    place = folder / PLANTS
    place.mkdir(parents=True, exist_ok=True)
    for suffix, text in zip(LAWS, (law, memory), strict=True):
        beside = place / f"{slug(record.plant)}{suffix}"
        if text:
            _write(beside, text)
        else:
            beside.unlink(missing_ok=True)  # that of a former run is not this record's
    path = place / f"{slug(record.plant)}.json"
    _write(path, json.dumps(to_plain(record), indent=1, allow_nan=False) + "\n")
    return path


def read_record(path: Path) -> PlantRecord:
    """Return the record of a file; raises FormatError when it holds none."""
    try:
        return from_plain(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, FormatError) as error:
        raise FormatError(f"{path} holds no record of the suite: {error}") from error


def read_records(folder: Path, order: Sequence[str] = ()) -> list[PlantRecord]:
    """Return the records in a folder, those named in `order` first and in that order.

    Raises
    ------
    FormatError : there is none, or a file that is none
    """
    paths = [path for path in sorted((folder / PLANTS).glob("*.json")) if not path.name.endswith(LAWS)]
    if not paths:
        raise FormatError(f"{folder} holds no records of the suite: run `python -m benchmarks suite --out {folder}` first")
    place = {name: index for index, name in enumerate(order)}
    records = [read_record(path) for path in paths]
    return sorted(records, key=lambda record: (place.get(record.plant, len(place)), record.plant))


def write_tables(folder: Path, records: Sequence[PlantRecord]) -> list[Path]:
    """Write all records into one JSON file and one CSV table, a line per plant and controller; return both paths."""
    folder.mkdir(parents=True, exist_ok=True)
    together, table = folder / ALL, folder / TABLE
    _write(together, json.dumps([to_plain(record) for record in records], indent=1, allow_nan=False) + "\n")
    partial = table.with_suffix(".partial")
    with partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(csv_rows(records))
    os.replace(partial, table)
    return [together, table]


def csv_rows(records: Iterable[PlantRecord]) -> list[dict[str, Any]]:
    """Return one mapping from columns to values per plant and controller; a plant without controllers has one as well."""
    return [_of_plant(record) | {one.name: _cell(getattr(entry, one.name)) for one in fields(Entry)}
            for record in records for entry in (record.entries or (Entry(""),))]


def _of_plant(record: PlantRecord) -> dict[str, Any]:
    n, m, p = record.sizes
    bounds = {family: _cell(record.bound(family)) for family in ("any", "linear", "static")}
    return {"plant": record.plant, "n": n, "m": m, "p": p, "source": record.source, **bounds,
            "seed": record.settings.seed, "commit": record.environment.commit, "date": record.environment.date,
            "failure": record.error, **{f"s, {stage}": _cell(record.stages.get(stage)) for stage in STAGES}}


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, tuple):
        return " ".join(value)
    return repr(value) if isinstance(value, float) else value  # every double comes back bit for bit


def _write(path: Path, text: str) -> None:
    """Write a whole file or none: an interruption leaves what was there before."""
    partial = path.with_suffix(path.suffix + ".partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)
