"""A synthesized law against one competitor on one plant: who costs less, as far as certificates say."""

from __future__ import annotations

from dataclasses import dataclass

from inc_casadi.comparison.row import EXACT, LYAPUNOV, VIOLATED

from .record import Entry, PlantRecord, is_absent
from .settings import MEMORY, SYNTHESIZED

OURS = (SYNTHESIZED, MEMORY)
GAIN, SATURATED, CLIPPED = "best linear gain", "saturated LQR", "clipped gain"
REMEMBERING = ("saturated LQG", "MPC", "best dynamic linear")  # where not all states are measured
WINS, TIES, LOSES, OPEN, ABSENT = "costs less", "the same", "costs more", "not decided", "no such controller"
THRESHOLD = 1e-4  # by this share of the competitor's cost a difference counts


@dataclass(frozen=True)
class Duel:
    """outcome: of the synthesized law, WINS, TIES or LOSES; OPEN when certificates do not decide, ABSENT when the plant has
    no such rival. share: by what share of the rival's cost its certified cost is lower, None when nothing is decided;
    rival: the competitor; reason: why nothing is decided."""

    outcome: str
    share: float | None
    rival: str
    reason: str = ""


def duel(record: PlantRecord, *rivals: str, own: str = SYNTHESIZED) -> Duel:
    """Return the duel of a synthesized law, the static one by default, with the first of the rivals that has a controller.

    J_INC <= its certified cost, so it costs less wherever that is below the rival's cost J. The latter must be known from
    below: an exact cost, or a linear loop's by its Lyapunov equation. Against an upper bound or a simulation nothing is
    decided, nor against one that breaks the input limits.

    >>> from .sample import record
    >>> duel(record(1.5, {"saturated LQR": 2.0}), "saturated LQR")
    Duel(outcome='costs less', share=0.25, rival='saturated LQR', reason='')
    """
    ours = record.entry(own)
    found = [entry for name in rivals if (entry := record.entry(name)) is not None]
    if record.error:
        return Duel(OPEN, None, rivals[0], record.error)
    if not found:
        return Duel(ABSENT, None, rivals[0], f"the {rivals[0]} was not asked for")
    rival = next((one for one in found if not is_absent(one)), None)
    if rival is None:
        return Duel(ABSENT, None, found[0].name, "; ".join(f"there is no {one.name}: {one.reason}" for one in found))
    if reason := _missing(own, ours) or _unfit(rival):
        return Duel(OPEN, None, rival.name, reason)
    assert ours is not None and ours.cost is not None and rival.cost is not None
    share = 1 - ours.cost / rival.cost if rival.cost > 0 else 0.0
    if abs(share) <= THRESHOLD:
        return Duel(TIES, share, rival.name)
    return Duel(WINS if share > 0 else LOSES, share, rival.name)


def gain_duel(record: PlantRecord) -> Duel:
    """Return the duel with the best static linear gain."""
    return duel(record, GAIN)


def saturated_duel(record: PlantRecord) -> Duel:
    """Return the duel with the saturated regulator, or where not all states are measured with the clipped best gain."""
    return duel(record, SATURATED, CLIPPED)


def stronger(record: PlantRecord, own: str = SYNTHESIZED, memory: bool | None = None) -> Entry | None:
    """Return the competitor that is certified to cost least, if that is less than the certified cost of our law.

    memory : only those with a state of their own, or only those without

    >>> from .sample import record
    >>> stronger(record(2.0, {"LQG": 1.5, "MPC": 1.4})).name
    'MPC'
    """
    ours = record.entry(own)
    best = cheapest(record, memory)
    if ours is None or ours.cost is None or not ours.certified or best is None or best.cost is None:
        return None
    return best if best.cost < (1 - THRESHOLD) * ours.cost else None


def cheapest(record: PlantRecord, memory: bool | None = None) -> Entry | None:
    """Return the competitor with the least certified cost; memory as for `stronger`."""
    certain = [one for one in record.entries if one.name not in OURS and one.certified and one.cost is not None
               and memory in (None, bool(one.order))]
    return min(certain, key=lambda one: one.cost or 0.0, default=None)


def _missing(name: str, own: Entry | None) -> str:
    if own is None or is_absent(own):
        return f"there is no {name}"
    return "" if own.certified else f"the {name} is not certified"


def _unfit(rival: Entry) -> str:
    if rival.cost is None:
        return f"nothing is known of the {rival.name}: {rival.reason}"
    if rival.limits == VIOLATED:
        return f"the {rival.name} breaks the input limits"
    if not rival.certified:
        return f"the {rival.name} has no certified cost"
    return "" if rival.how in (EXACT, LYAPUNOV) else f"only an upper bound is known for the cost of the {rival.name}"
