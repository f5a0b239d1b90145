"""What is written down of one plant: its controllers, the lower bounds, and how it all came about. Plain values only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from inc_casadi.errors import FormatError

from .settings import Settings

VERSION = 2
ABSENT, UNSUITED = "not found", "does not apply"  # kinds of entries without a controller


def is_absent(entry: Entry) -> bool:
    """Return whether there is no such controller on the plant."""
    return entry.kind in (ABSENT, UNSUITED)


@dataclass(frozen=True)
class Entry:
    """One controller on one plant; what is not known is None.

    Parameters
    ----------
    name, kind : which, and what it is in words
    units, order : hidden units, states of its own
    cost, how, error : the expected discounted cost, how it is known as rows of `inc_casadi.comparison` say, its standard
        error when simulated
    certified : whether cost and limits are certified; proved: whether they were settled rigorously, None when not tried
    limits : the verdict on the input limits
    worst : certified largest cost over the initial set
    gap : by what share the certified cost exceeds the lower bound on any controller
    beats : the classes every member of which is proved to cost more
    factor, refuted : the initial set grown by `factor` is certified still, by `refuted` it is not
    design, judged : processor seconds to find it, and to find out what it costs
    evaluation : microseconds for one input in Python
    reason : what was tried and failed, or why there is no such controller
    """

    name: str
    kind: str = ABSENT
    units: int | None = None
    order: int | None = None
    cost: float | None = None
    how: str = "unknown"
    error: float | None = None
    certified: bool = False
    proved: bool | None = None
    limits: str = "unknown"
    worst: float | None = None
    gap: float | None = None
    beats: tuple[str, ...] = ()
    factor: float | None = None
    refuted: float | None = None
    design: float = 0.0
    judged: float = 0.0
    evaluation: float | None = None
    reason: str = ""


@dataclass(frozen=True)
class LowerBound:
    """What no controller of a class can undercut. family: "any", "linear" or "static"; value: None when there is none;
    holds: whether its numbers prove it; reason: why there is none; seconds."""

    family: str
    value: float | None
    holds: bool
    reason: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Environment:
    """Where and when a record was made. versions: of Python and the libraries, by name; source: digest of the code that
    measures; commit: "" when unknown; cores; memory in GiB, None when unknown; system; date in UTC."""

    versions: Mapping[str, str]
    source: str
    commit: str
    cores: int
    memory: float | None
    system: str
    date: str

    def same_code(self, other: Environment) -> bool:
        """Return whether the same versions and the same source were at work, wherever and whenever, committed or not."""
        return dict(self.versions) == dict(other.versions) and self.source == other.source


@dataclass(frozen=True)
class PlantRecord:
    """Everything about one plant of the suite. sizes: (n, m, p); source: where it is published; digest: of plant and
    specification; inversions: contradictions between costs and bounds; seconds: of wall time; stages: processor seconds by
    stage and "in all", and as `synthesize` counts its phases those of wall time; error: why there is nothing."""

    plant: str
    sizes: tuple[int, int, int]
    source: str
    digest: str
    settings: Settings
    environment: Environment
    entries: tuple[Entry, ...] = ()
    bounds: tuple[LowerBound, ...] = ()
    inversions: tuple[str, ...] = ()
    seconds: float = 0.0
    stages: Mapping[str, float] = field(default_factory=dict)
    error: str = ""

    @property
    def sees_all(self) -> bool:
        """Whether there are as many measurements as states."""
        return self.sizes[2] >= self.sizes[0]

    @property
    def processor(self) -> float:
        """Processor seconds in all, or of wall time where those are not known."""
        return self.stages.get("in all", self.seconds)

    def entry(self, name: str) -> Entry | None:
        """Return what is known of the controller of that name, or None."""
        return next((one for one in self.entries if one.name == name), None)

    def bound(self, family: str) -> float | None:
        """Return the lower bound on a class, None when there is none that holds."""
        return next((one.value for one in self.bounds if one.family == family and one.holds), None)


def to_plain(record: PlantRecord) -> dict[str, Any]:
    """Return a record as JSON content; `from_plain` is its inverse."""
    return {"version": VERSION, **asdict(record)}


def from_plain(content: Any) -> PlantRecord:
    """Return the record of JSON content.

    Raises
    ------
    FormatError : it is none, or of another version

    >>> from_plain({"version": 0})
    Traceback (most recent call last):
    inc_casadi.errors.FormatError: a record of the suite must be of version 2, not 0
    """
    if not isinstance(content, dict):
        raise FormatError(f"a record of the suite must be an object, not {type(content).__name__}")
    if content.get("version") != VERSION:
        raise FormatError(f"a record of the suite must be of version {VERSION}, not {content.get('version')!r}")
    body = {key: value for key, value in content.items() if key != "version"}
    body["settings"] = _made(Settings, body.get("settings"))
    body["environment"] = _made(Environment, body.get("environment"))
    body["entries"] = [_made(Entry, one) for one in _listed("entries", body.get("entries"))]
    body["bounds"] = [_made(LowerBound, one) for one in _listed("bounds", body.get("bounds"))]
    return _made(PlantRecord, body)  # type: ignore[no-any-return]


def _made(kind: type, content: Any) -> Any:
    """A dataclass of JSON content, lists turned into tuples; nothing missing or besides."""
    names = {one.name for one in fields(kind)}
    found = set(content) if isinstance(content, dict) else set()
    if found != names:
        odd = ", ".join(sorted(found ^ names))
        raise FormatError(f"a record of the suite holds no whole {kind.__name__}: {odd} missing or unknown")
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in content.items()})


def _listed(key: str, content: Any) -> list[Any]:
    if not isinstance(content, list | tuple):
        raise FormatError(f"{key} of a record of the suite must be a list, not {type(content).__name__}")
    return list(content)
