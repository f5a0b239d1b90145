"""The results page in Markdown, written from records alone."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from inc_casadi.figures import at_least, at_most

from .reasons import reasons, telling
from .record import ABSENT, UNSUITED, Entry, Environment, PlantRecord
from .shares import above
from .sheets import Sheet
from .summary import sentences, summary
from .table import HEADINGS, LEGEND, MEMORY_TITLE, WITH_MEMORY, cells, cost, memory_cells, remembering

DETAILS = ("controller", "kind", "expected cost", "known", "limits", "worst case", "above the best", "beats all",
           "initial set x", "design, s", "judged, s", "input, µs")
PICTURES = {"costs.png": "cost of each controller above the lower bound on any controller",
            "wins.png": "on how many plants the synthesized INC costs less than each competitor",
            "times.png": "time to design a controller and to evaluate it once"}
CLASSES = (
    "Two classes of controllers are compared. A *static* law answers the present measurement alone: the synthesized INC, "
    "linear gains, the saturated LQR and, where the whole state is measured, the MPC. A law *with memory* keeps a state of "
    "its own: the synthesized INC with memory, LQG, saturated LQG, dynamic linear controllers, and the MPC on the estimate "
    "of an observer. Where the whole state is measured, memory gains nothing, for the best law of all is static: all "
    "controllers are comparable. Where it is not, compare static with static and memory with memory: what is not measured "
    "may be estimated with memory only, so that a static law may cost more than the LQG and be the best of its class.")
NOTE = ("Written by `python -m benchmarks page` from the records of `python -m benchmarks suite`; no figure is typed by "
        "hand. A lower bound on a class holds for every member of it. What is left to win at most is the share by which the "
        "certified cost exceeds the bound on all controllers, with memory or without. Seconds are of the processor.")
ABSENCES = ("Left out are controllers that a plant has no use for: LQG, saturated LQG, clipped gain and INC with memory "
            "where the whole state is measured, scaled and saturated LQR where it is not.")


def page(records: Sequence[PlantRecord], sheets: Sequence[Sheet] = (), pictures: str = "") -> str:
    """Return the page: what the run comes to, how it was made, the plants, why nothing is won, every controller.

    records : of the suite, in the order of the table
    sheets : tables of other commands
    pictures : the folder of the charts, as a relative link from where the page will be; "" for none

    >>> from .sample import record
    >>> print(page([record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.4})]).splitlines()[2])
    - The synthesized INC, a static law, is certified on 1 of 1 plant (0 settled rigorously).
    """
    lines = ["# Results", "", *(f"- {one}" for one in sentences(summary(records))), "", CLASSES, "", *_made(records), "",
             "## Plants", "", *_markdown(HEADINGS, map(cells, records)), "", LEGEND, ""]
    if blind := remembering(records):
        lines += [f"{MEMORY_TITLE}.", "", *_markdown(WITH_MEMORY, map(memory_cells, blind)), ""]
    for name, words in PICTURES.items() if pictures else ():
        lines += [f"![{words}]({pictures}/{name})", ""]
    lines += [*_reasons(records), *_details(records)]
    for sheet in sheets:
        lines += [f"## `python -m benchmarks {sheet.title}`", "", _where(sheet.environment), ""]
        lines += ["```", sheet.text, "```", ""]
    return "\n".join(lines).rstrip() + "\n"


def write_page(path: Path, records: Sequence[PlantRecord], sheets: Sequence[Sheet] = (), folder: Path | None = None) -> Path:
    """Write the page, with links to the charts in `folder` when they are there; return the path."""
    drawn = folder is not None and all((folder / name).exists() for name in PICTURES)
    path.parent.mkdir(parents=True, exist_ok=True)
    link = Path(os.path.relpath(folder, path.parent)).as_posix() if drawn and folder is not None else ""
    path.write_text(page(records, sheets, link), encoding="utf-8")
    return path


def _made(records: Sequence[PlantRecord]) -> Iterator[str]:
    """How the records came about: one line per kind of machine and code, and per kind of settings."""
    yield NOTE
    yield ""
    yield from dict.fromkeys(f"- {_where(record.environment, dated=False)}" for record in records)
    dates = sorted(record.environment.date for record in records)
    if dates:
        seconds = sum(record.processor for record in records)
        yield f"- From {dates[0]} to {dates[-1]}; {seconds:.0f} s for all plants together{_spent(records)}."
    for one in dict.fromkeys(record.settings for record in records):
        yield (f"- Seed {one.seed}; {one.hidden} hidden units to train; a search of {one.search:g} s for each synthesized "
               f"law, {one.training:g} s for one training or proof, {one.pieces:g} s for the pieces of a competitor, "
               f"{one.gains:g} s for static gains.")


def _where(one: Environment, dated: bool = True) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in one.versions.items())
    memory = "memory unknown" if one.memory is None else f"{one.memory:g} GiB"
    commit = f", commit {one.commit}" if one.commit else ""
    machine = f"{one.system}, {one.cores} cores, {memory}"
    return f"{versions}{commit}, source {one.source}; {machine}{'; ' + one.date if dated else ''}."


def _spent(records: Sequence[PlantRecord]) -> str:
    """Where the seconds went, most first."""
    total: dict[str, float] = {}
    for record in records:
        for stage, seconds in record.stages.items():
            if stage != "in all" and not stage.endswith("(wall)"):
                total[stage] = total.get(stage, 0.0) + seconds
    parts = [f"{stage} {total[stage]:.0f}" for stage in sorted(total, key=lambda stage: -total[stage])]
    return f": {', '.join(parts)}" if parts else ""


def _reasons(records: Sequence[PlantRecord]) -> list[str]:
    found = [f"- {_safe(line)}." for line in reasons(records)]
    return ["## Where the INC does not cost less, and why", "", *found, ""] if found else []


def _details(records: Sequence[PlantRecord]) -> Iterator[str]:
    yield from ("## Every controller", "", ABSENCES, "")
    for record in records:
        yield from (f"### {record.plant}", "", f"{_sizes(record)}. {_floors(record)}", "")
        if record.error:
            yield from (f"The measurement failed: {_safe(record.error)}.", "")
            continue
        suited = [entry for entry in record.entries if entry.kind != UNSUITED]
        yield from _markdown(DETAILS, (_detail(entry) for entry in suited if entry.kind != ABSENT))
        yield from ("", *_missing(suited), "")


def _missing(entries: Iterable[Entry]) -> Iterator[str]:
    """Why there is none, or none that is certified: controllers with the same reason in one line."""
    names: dict[str, list[str]] = {}
    for entry in entries:
        if not entry.certified and entry.reason:
            names.setdefault(telling(entry.reason), []).append(entry.name)
    yield from (f"- {', '.join(found)}: {_safe(reason)}" for reason, found in names.items())


def _detail(entry: Entry) -> tuple[str, ...]:
    known = entry.how + (", proved" if entry.proved else ", certified" if entry.certified else "")
    factor = "-" if entry.factor is None else f"{at_least(entry.factor, 3)}" + (
        "" if entry.refuted is None else f", not {at_most(entry.refuted, 3)}")
    return (entry.name, entry.kind, cost(entry), known if entry.cost is not None else "-",
            entry.limits if entry.cost is not None else "-",
            "-" if entry.worst is None else at_most(entry.worst, 5), "-" if entry.gap is None else above(entry.gap),
            next((family for family in ("linear", "static") if family in entry.beats), "-"), factor, f"{entry.design:.2g}",
            f"{entry.judged:.2g}", "-" if entry.evaluation is None else f"{entry.evaluation:.0f}")


def _sizes(record: PlantRecord) -> str:
    counts = zip(record.sizes, ("state", "input", "measurement"), strict=True)
    return f"{', '.join(f'{count} {word}s' if count > 1 else f'1 {word}' for count, word in counts)}; {_safe(record.source)}"


def _floors(record: PlantRecord) -> str:
    titles = {"any": "any controller", "linear": "every linear one", "static": "every static gain"}
    parts = [f"{titles[one.family]} {at_least(one.value)}" if one.holds and one.value is not None
             else f"{titles[one.family]}: no bound ({_safe(one.reason)})" for one in record.bounds]
    return f"Costs at least: {'; '.join(parts)}." if parts else ""


def _markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield "| " + " | ".join(map(_safe, headings)) + " |"
    yield "|" + "---|" * len(headings)
    for row in rows:
        yield "| " + " | ".join(map(_safe, row)) + " |"


def _safe(words: str) -> str:
    """Words that Markdown does not read as anything else."""
    for mark in "\\|*_`<":
        words = words.replace(mark, "\\" + mark)
    return words
