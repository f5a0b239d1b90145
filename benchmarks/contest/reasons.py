"""Why a synthesized law costs no less than its competitors, in words that follow from the record."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from .duels import ABSENT, LOSES, OPEN, THRESHOLD, TIES, cheapest, gain_duel, saturated_duel, stronger
from .record import UNSUITED, Entry, PlantRecord
from .settings import MEMORY, SYNTHESIZED
from .shares import above, won

NOTHING_LEFT = 1e-3  # within this share of the lower bound `synthesize` stops looking
LONG = 200
DECISIVE = ("no static gain u = f y stabilizes",)  # a proof, and so the first to be said
ADVICE = re.compile(r"(: measure more| Try |; that is evidence|, so no static law).*")
COURSE = re.compile(r"\d+ attempts? in|the time is over|lower bound, |cut short by|no other static law|laws with a kink")


@dataclass(frozen=True)
class Reason:
    """Why something costs no less, in words that plants may share, and what is left to win on this one."""

    words: str
    left: str = ""

    def __str__(self) -> str:
        return f"{self.words} ({self.left})" if self.left else self.words


def reasons(records: Sequence[PlantRecord]) -> list[str]:
    """Return why the static INC, then why the one with memory costs no less: plants with the same reason in one line.

    >>> from .sample import record
    >>> tie = record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.0}, floor=1.99999)
    >>> print(*reasons([tie]))
    made up: nothing left to win, for the saturated LQR is within 0.1 % of the bound on any controller (0.00051 % left)
    """
    static = [(record.plant, why(record)) for record in records]
    memory = [(record.plant, why_with_memory(record)) for record in records]
    found = [*_together(static), *(f"with memory, {line}" for line in _together(memory))]
    return found + [f"INCONSISTENT, {record.plant}: {one}" for record in records for one in record.inversions]


def _together(found: Sequence[tuple[str, Reason | None]]) -> list[str]:
    groups: dict[str, list[tuple[str, Reason]]] = {}
    for plant, reason in found:
        if reason is not None:
            groups.setdefault(reason.words, []).append((plant, reason))
    return [f"{members[0][0]}: {members[0][1]}" if len(members) == 1 else
            f"{words}: {'; '.join(f'{plant} ({one.left})' if one.left else plant for plant, one in members)}"
            for words, members in groups.items()]


def why(record: PlantRecord) -> Reason | None:
    """Return why the static INC is not certified, or does not cost less than its two static rivals, and which static
    competitor is certified to cost less than it; None when there is nothing of that.

    How much may be left to win is an upper bound, for the lower bound on any controller need not be attained.

    >>> from .sample import record
    >>> print(why(record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.0}, floor=1.5)))
    no static law was found that costs less than the saturated LQR (at most 34 % left)
    """
    if record.error:
        return Reason(f"the measurement failed: {record.error}")
    own = record.entry(SYNTHESIZED)
    if own is None:
        return Reason("no law was synthesized")
    if not own.certified:
        return Reason(f"not certified: {telling(own.reason)}")
    duels = (gain_duel(record), saturated_duel(record))
    best = stronger(record, memory=False)
    parts = [telling(one.reason) for one in duels if one.outcome in (OPEN, ABSENT)]
    parts += [f"it costs {above(-(one.share or 0.0))} more than the {one.rival}" for one in duels if one.outcome == LOSES]
    if best is not None and all(best.name != one.rival or one.outcome != LOSES for one in duels):
        parts.append(_cheaper(best, own))
    tied = [f"the {one.rival}" for one in duels if one.outcome == TIES]
    if tied and not parts and own.gap is not None and own.gap <= NOTHING_LEFT:
        return Reason(f"nothing left to win, for {' and '.join(tied)} is within {100 * NOTHING_LEFT:g} % of the bound on "
                      "any controller", f"{above(own.gap)} left")
    if tied:
        parts.append(f"no static law was found that costs less than {' or '.join(tied)}")
    return Reason("; ".join(dict.fromkeys(parts)), _left(own)) if parts else None


def why_with_memory(record: PlantRecord) -> Reason | None:
    """Return why the INC with memory is not certified, or which competitor costs no more; None when all cost more.

    >>> from .sample import entry, record
    >>> made = record(None, {}, entries=(entry(MEMORY, 2.0, order=2, gap=1.0), entry("MPC", 1.5, order=2)))
    >>> print(why_with_memory(made))
    the MPC is certified to cost 25 % less (at most 100 % left)
    """
    own = record.entry(MEMORY)
    if own is None or record.error or own.kind == UNSUITED:
        return None
    if not own.certified:
        return Reason(f"not certified: {telling(own.reason)}")
    best = cheapest(record)
    assert own.cost is not None
    if best is None or best.cost is None or own.cost < (1 - THRESHOLD) * best.cost:
        return None
    cheaper = stronger(record, MEMORY)
    return Reason(_cheaper(cheaper, own) if cheaper else f"it costs the same as the {best.name}", _left(own))


def telling(reason: str) -> str:
    """Return the part of a reason that tells most, without advice and without the course of the search.

    >>> telling("static gain: no gain was found. Try more starts.; 2 attempts in 1 round; the time is over")
    'static gain: no gain was found'
    >>> telling("")
    'no reason is known'
    """
    parts = [ADVICE.sub("", part).rstrip(".") for part in re.split(r"; (?!that is evidence)", reason)]
    parts = [part for part in parts if part and not COURSE.match(part)] or [reason or "no reason is known"]
    first = next((part for part in parts if part.startswith(DECISIVE)), parts[0])
    return first if len(first) <= LONG else first[:LONG].rsplit(" ", 1)[0] + " ..."


def _left(own: Entry) -> str:
    return "no lower bound says what is left" if own.gap is None else f"at most {above(own.gap)} left"


def _cheaper(best: Entry, own: Entry) -> str:
    return f"the {best.name} is certified to cost {won(1 - (best.cost or 0.0) / (own.cost or 1.0))} less"
