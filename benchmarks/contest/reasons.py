"""Why nothing is won on a plant, in words that follow from its record."""

from __future__ import annotations

from .duels import ABSENT, LOSES, OPEN, TIES, Duel, gain_duel, saturated_duel, stronger
from .record import Entry, PlantRecord
from .settings import SYNTHESIZED
from .shares import above, won

NOTHING_LEFT = 1e-3  # within this share of the lower bound `synthesize` stops looking
LONG = 300


def why(record: PlantRecord) -> str:
    """Return why the synthesized law is not certified, or does not cost less than its two rivals, and which competitor is
    certified to cost less than it; "" when there is nothing of that.

    The saturated regulator may be close to the best possible, and then nothing is left to win; else it says how much may
    be left, which is an upper bound, for the lower bound on any controller need not be attained.

    >>> from .sample import record
    >>> why(record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.0}, floor=1.99999))
    'the saturated LQR is within 0.00051 % of the bound on any controller: nothing left to win'
    """
    if record.error:
        return f"the measurement failed: {record.error}"
    own = record.entry(SYNTHESIZED)
    if own is None:
        return "no law was synthesized"
    if not own.certified:
        return f"not certified: {_short(own.reason) or 'no reason is known'}"
    parts = [_of(one, record, own) for one in (gain_duel(record), saturated_duel(record))]
    best = stronger(record)
    if best is not None and best.cost is not None and own.cost is not None:
        memory = ", which has a state of its own," if best.order else ""
        parts.append(f"the {best.name}{memory} is certified to cost {won(1 - best.cost / own.cost)} less")
    return "; ".join(dict.fromkeys(filter(None, parts)))


def _of(one: Duel, record: PlantRecord, own: Entry) -> str:
    if one.outcome in (OPEN, ABSENT):
        return _short(one.reason)
    if one.outcome not in (TIES, LOSES):
        return ""
    rival = record.entry(one.rival)
    assert rival is not None
    if rival.gap is not None and rival.gap <= NOTHING_LEFT:
        return f"the {one.rival} is within {above(rival.gap)} of the bound on any controller: nothing left to win"
    words = (f"no law was found that costs less than the {one.rival}" if one.outcome == TIES
             else f"it costs {above(-(one.share or 0.0))} more than the {one.rival}")
    if own.gap is None:
        return f"{words}; no lower bound says what is left to win"
    return f"{words}; at most {above(own.gap)} is left to win"


def _short(words: str) -> str:
    return words if len(words) <= LONG else words[:LONG].rsplit(" ", 1)[0] + " ..."
