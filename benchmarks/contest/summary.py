"""What a run of the suite comes to, counted from its records and said in sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median

from .duels import ABSENT, LOSES, OPEN, REMEMBERING, THRESHOLD, TIES, WINS, Duel, duel, gain_duel, saturated_duel, stronger
from .record import PlantRecord
from .settings import MEMORY, SYNTHESIZED
from .shares import won


@dataclass(frozen=True)
class Tally:
    """The duels with one kind of competitor over all plants: how many each way, and by what shares it was won."""

    won: int
    same: int
    lost: int
    open: int
    absent: int
    shares: tuple[float, ...]

    @property
    def decided(self) -> int:
        """How many plants have an outcome."""
        return self.won + self.same + self.lost


@dataclass(frozen=True)
class Memory:
    """The INC with memory on the plants that do not measure their state. plants: how many; certified, proved: of its laws;
    duels: by competitor, the static INC among them; stronger: how often which competitor is certified to cost less."""

    plants: int
    certified: int
    proved: int
    duels: tuple[tuple[str, Tally], ...]
    stronger: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Summary:
    """Counts over the plants. plants: all; certified: with a certified static law; proved: settled rigorously as well;
    gain, saturated: the duels; linear: where every linear controller is proved to cost more; static, remembering: how often
    which competitor without and with memory is certified to cost less, the least of its kind; memory: of the INC with
    memory, None when it took no part; failed: without any figure; inversions: contradictions."""

    plants: int
    certified: int
    proved: int
    gain: Tally
    saturated: Tally
    linear: int
    static: tuple[tuple[str, int], ...]
    remembering: tuple[tuple[str, int], ...]
    memory: Memory | None
    failed: int
    inversions: int


def tally(records: Sequence[PlantRecord], judge: Callable[[PlantRecord], Duel]) -> Tally:
    """Return the count of duels.

    >>> from .sample import record
    >>> tally([record(2.0, {"best linear gain": 2.5}), record(2.0, {})], gain_duel)
    Tally(won=1, same=0, lost=0, open=0, absent=1, shares=(0.2,))
    """
    duels = [judge(record) for record in records]
    count = {outcome: sum(one.outcome == outcome for one in duels) for outcome in (WINS, TIES, LOSES, OPEN, ABSENT)}
    shares = tuple(round(one.share, 12) for one in duels if one.outcome == WINS and one.share is not None)
    return Tally(count[WINS], count[TIES], count[LOSES], count[OPEN], count[ABSENT], shares)


def summary(records: Sequence[PlantRecord]) -> Summary:
    """Return all counts of a run."""
    own = [entry for record in records if (entry := record.entry(SYNTHESIZED)) is not None and entry.certified]
    return Summary(len(records), len(own), sum(bool(entry.proved) for entry in own), tally(records, gain_duel),
                   tally(records, saturated_duel), sum("linear" in entry.beats for entry in own),
                   _counted(records, SYNTHESIZED, False), _counted(records, SYNTHESIZED, True), _memory(records),
                   sum(bool(record.error) for record in records), sum(len(record.inversions) for record in records))


def _memory(records: Sequence[PlantRecord]) -> Memory | None:
    blind = [record for record in records if not record.sees_all and record.entry(MEMORY) is not None]
    own = [entry for record in blind if (entry := record.entry(MEMORY)) is not None and entry.certified]
    duels = tuple((name, tally(blind, partial(_against_memory, rival=name))) for name in (*REMEMBERING, SYNTHESIZED))
    return Memory(len(blind), len(own), sum(bool(entry.proved) for entry in own), duels,
                  _counted(blind, MEMORY, None)) if blind else None


def _against_memory(record: PlantRecord, rival: str) -> Duel:
    return duel(record, rival, own=MEMORY)


def _counted(records: Sequence[PlantRecord], own: str, memory: bool | None) -> tuple[tuple[str, int], ...]:
    found = Counter(entry.name for record in records if (entry := stronger(record, own, memory)) is not None)
    return tuple(found.most_common())


def sentences(found: Summary) -> tuple[str, ...]:
    """Return the sentences that a results page begins with.

    >>> from .sample import record
    >>> for one in sentences(summary([record(2.0, {"best linear gain": 2.5, "saturated LQR": 2.0})])):
    ...     print(one)
    The synthesized INC, a static law, is certified on 1 of 1 plant (0 settled rigorously).
    It costs less than the best linear static gain found on 1 of 1 plant, by 20 % in the median and 20 % at most.
    It costs less than the saturated LQR (where not all states are measured, the clipped best gain) on 0 of 1 plant, the same
    on 1.
    No static competitor is certified to cost less than it.
    On 0 it is proved to cost less than every linear controller of any finite order.
    Compared are plants where both costs are certified and the rival's is known exactly; a difference counts from 0.01 % on.
    """
    rivals = (("the best linear static gain found", found.gain),
              ("the saturated LQR (where not all states are measured, the clipped best gain)", found.saturated))
    out = [f"The synthesized INC, a static law, is certified on {found.certified} of {_plants(found.plants)} "
           f"({found.proved} settled rigorously)."]
    out += [_against("It", name, count) for name, count in rivals]
    out.append(_stronger("static competitor", found.static) or "No static competitor is certified to cost less than it.")
    out.append(f"On {found.linear} it is proved to cost less than every linear controller of any finite order.")
    out += [*filter(None, [_stronger("competitor with memory", found.remembering)]), *_with_memory(found.memory)]
    out.append("Compared are plants where both costs are certified and the rival's is known exactly; a difference counts "
               f"from {100 * THRESHOLD:g} % on.")
    if found.failed:
        out.append(f"Nothing is known of {found.failed}, where the measurement itself failed.")
    if found.inversions:
        out.append(f"INCONSISTENT: {found.inversions} certified costs contradict a lower bound.")
    return tuple(out)


def _with_memory(found: Memory | None) -> list[str]:
    if found is None:
        return []
    out = [f"The synthesized INC with memory is certified on {found.certified} of {_plants(found.plants)} whose state is "
           f"not wholly measured ({found.proved} settled rigorously)."]
    said = [_against("", "the static INC" if name == SYNTHESIZED else f"the {name}", count) for name, count in found.duels]
    out.append(f"It costs less {'; '.join(one.rstrip('.') for one in said)}.")
    out.append(_stronger("competitor", found.stronger) or "No competitor is certified to cost less than that.")
    return out


def _stronger(kind: str, found: tuple[tuple[str, int], ...]) -> str:
    if not found:
        return ""
    names = ", ".join(f"the {name} on {number}" for name, number in found)
    return f"A {kind} is certified to cost less than it on {sum(number for _, number in found)}: {names}."


def _against(subject: str, name: str, count: Tally) -> str:
    words = f"{subject} costs less than" if subject else "than"
    words += f" {name} on {count.won} of {_plants(count.decided)}"
    if count.shares:
        words += f", by {won(median(count.shares))} in the median and {won(max(count.shares))} at most"
    words += f", the same on {count.same}" if count.same else ""
    return words + (f", more on {count.lost}" if count.lost else "") + "."


def _plants(count: int) -> str:
    return f"{count} plant{'s' if count != 1 else ''}"
