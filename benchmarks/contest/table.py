"""The table of the suite: a line per plant, the same cells in the terminal and on the results page."""

from __future__ import annotations

from collections.abc import Sequence

from inc_casadi.comparison.table import columns
from inc_casadi.figures import at_least, at_most

from .duels import CLIPPED, Duel, gain_duel, saturated_duel
from .reasons import why
from .record import Entry, PlantRecord
from .settings import SYNTHESIZED
from .shares import above, won
from .summary import sentences, summary

HEADINGS = ("plant", "n m p", "any >=", "INC", "known", "units", "above the best", "best linear gain", "INC less by",
            "saturated LQR", "INC less by", "beats all", "initial set x", "s")
LEGEND = ("Costs are certified and rounded up; ~ simulated, ? not certified, ! breaks the limits, - none; "
          "c: the clipped best gain, where not all states are measured.")


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
            f"{record.seconds:.0f}")


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
    """Return the table as text, then what it comes to, then why nothing is won where nothing is.

    >>> from .sample import record
    >>> print(table([record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.4})]).splitlines()[1][:48])
    made up  2 1 1  1       2    exact  1      100 %
    """
    lines = list(columns([HEADINGS, *map(cells, records)]))
    lines += [LEGEND, "", *sentences(summary(records)), ""]
    lines += [f"{record.plant}: {reason}" for record in records if (reason := why(record))]
    lines += [f"INCONSISTENT, {record.plant}: {one}" for record in records for one in record.inversions]
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
    return f"{head}INC {words}: {duels}; {record.seconds:.1f} s"


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
