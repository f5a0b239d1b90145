"""The table of the suite: a line per plant, the same cells in the terminal and on the results page."""

from __future__ import annotations

from collections.abc import Sequence

from inc_casadi.comparison.table import columns
from inc_casadi.figures import at_least, at_most

from .duels import CLIPPED, REMEMBERING, Duel, duel, gain_duel, saturated_duel
from .reasons import reasons
from .record import Entry, PlantRecord
from .settings import MEMORY, SYNTHESIZED
from .shares import above, won
from .summary import sentences, summary

HEADINGS = ("plant", "n m p", "any >=", "INC", "known", "units", "above the best", "best linear gain", "INC less by",
            "saturated LQR", "INC less by", "beats all", "initial set x", "CPU s")
WITH_MEMORY = ("plant", "any >=", "static INC", "INC with memory", "known", "order", "units", "above the best", "less by",
               *(cell for name in REMEMBERING for cell in (name, "less by")))
LEGEND = ("Costs are certified and rounded up; ~ simulated, ? not certified, ! breaks the limits, - none; "
          "c: the clipped best gain, where not all states are measured; \"above the best\": what is left to win at most; "
          "\"beats all\": the largest class whose every member is proved to cost more; \"initial set x\": grown by so much "
          "it is certified still.")
MEMORY_TITLE = "Laws with memory, on plants that do not measure their state; \"less by\": the INC with memory"


def cells(record: PlantRecord) -> tuple[str, ...]:
    """Return the cells of a plant under HEADINGS.

    >>> from .sample import record
    >>> cells(record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.0}, floor=1.99))[2:11]
    ('1.99', '2', 'exact', '1', '0.51 %', '2.5', '20 %', '2', '0 %')
    """
    own = record.entry(SYNTHESIZED) or Entry(SYNTHESIZED)
    floor, gain, saturated = record.bound("any"), gain_duel(record), saturated_duel(record)
    known = own.how if own.cost is not None else "-"
    factor = "-" if own.factor is None else at_least(own.factor, 3)
    return (record.plant, " ".join(map(str, record.sizes)), "-" if floor is None else at_least(floor), cost(own), known,
            "-" if own.units is None else str(own.units), "-" if own.gap is None else above(own.gap),
            _rival(record, gain), _less(gain), _rival(record, saturated), _less(saturated), _beaten(own), factor,
            f"{record.processor:.0f}")


def memory_cells(record: PlantRecord) -> tuple[str, ...]:
    """Return the cells of a plant under WITH_MEMORY.

    >>> from dataclasses import replace
    >>> from .sample import entry, record
    >>> made = record(2.0, {"MPC": 1.6}, floor=1.0)
    >>> memory_cells(replace(made, entries=(*made.entries, entry(MEMORY, 1.5, order=2, gap=0.5))))[2:9]
    ('2', '1.5', 'exact', '2', '1', '50 %', '25 %')
    """
    own, static = record.entry(MEMORY) or Entry(MEMORY), record.entry(SYNTHESIZED) or Entry(SYNTHESIZED)
    floor = record.bound("any")
    rivals = [cell for name in REMEMBERING
              for cell in (cost(record.entry(name) or Entry(name)), _less(duel(record, name, own=MEMORY)))]
    return (record.plant, "-" if floor is None else at_least(floor), cost(static), cost(own),
            own.how if own.cost is not None else "-", "-" if own.order is None else str(own.order),
            "-" if own.units is None else str(own.units), "-" if own.gap is None else above(own.gap),
            _less(duel(record, SYNTHESIZED, own=MEMORY)), *rivals)


def remembering(records: Sequence[PlantRecord]) -> list[PlantRecord]:
    """Return the records of plants that do not measure their state, where the INC with memory took part."""
    return [record for record in records if not record.sees_all and record.entry(MEMORY) is not None]


def cost(entry: Entry) -> str:
    """Return the cost of a controller with its mark.

    >>> from .sample import entry
    >>> cost(entry("a", 2.0)), cost(entry("a", 2.0, how="simulated", certified=False)), cost(entry("a", None))
    ('2', '~2', '-')
    """
    if entry.cost is None:
        return "-"
    if entry.limits == "violated":
        return f"!{entry.cost:.5g}"
    if entry.how == "simulated":
        return f"~{entry.cost:.5g}"
    return at_most(entry.cost) if entry.certified else f"?{entry.cost:.7g}"


def table(records: Sequence[PlantRecord]) -> str:
    """Return the tables as text, then what they come to, then why a synthesized law costs no less where it does not.

    >>> from .sample import record
    >>> print(table([record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.4})]).splitlines()[1][:48])
    made up  2 1 1  1       2    exact  1      100 %
    """
    lines = [*columns([HEADINGS, *map(cells, records)]), LEGEND, ""]
    if blind := remembering(records):
        lines += [f"{MEMORY_TITLE}:", *columns([WITH_MEMORY, *map(memory_cells, blind)]), ""]
    lines += [*sentences(summary(records)), "", *reasons(records)]
    return "\n".join(lines).rstrip()


def progress_line(record: PlantRecord, done: int, count: int) -> str:
    """Return the line that is said when a plant is finished.

    >>> from .sample import record
    >>> progress_line(record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.0}, floor=1.0), 1, 5)
    '[1/5] made up: INC 2, certified, exact: costs less (against best linear gain), the same (against saturated LQR); 3.0 s'
    """
    head = f"[{done}/{count}] {record.plant}: "
    if record.error:
        return f"{head}FAILED, {record.error}; {record.seconds:.1f} s"
    own = record.entry(SYNTHESIZED)
    if own is None:
        return f"{head}{len(record.entries)} competitors; {record.seconds:.1f} s"
    words = f"{cost(own)}, {'certified' if own.certified else 'not certified'}, {own.how}"
    duels = ", ".join(f"{one.outcome} (against {one.rival})" for one in (gain_duel(record), saturated_duel(record)))
    memory = record.entry(MEMORY)
    more = "" if memory is None or memory.cost is None else f"; with memory {cost(memory)}, {memory.how}"
    return f"{head}INC {words}: {duels}{more}; {record.seconds:.1f} s"


def _rival(record: PlantRecord, one: Duel) -> str:
    entry = record.entry(one.rival) or Entry(one.rival)
    return ("c " if one.rival == CLIPPED and entry.cost is not None else "") + cost(entry)


def _less(one: Duel) -> str:
    """By how much the synthesized law costs less; where it costs more, rounded up with a minus."""
    if one.share is None:
        return "-"
    return won(one.share if abs(one.share) > 1e-8 else 0.0)


def _beaten(own: Entry) -> str:
    """The largest class every member of which is proved to cost more."""
    return next((family for family in ("linear", "static") if family in own.beats), "-")
