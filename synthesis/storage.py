"""Keep a result in a file and open it again with its proofs checkable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from inc_casadi import INC, Plant, Spec, load, save
from inc_casadi.bounds import Bound
from inc_casadi.brief import Brief
from inc_casadi.certificate import Certificate
from inc_casadi.comparison.families import ANY, LINEAR
from inc_casadi.errors import FormatError
from inc_casadi.interchange.agreement import limits_kept, strange_bound, strange_certificate

from .causes import Cause
from .gate import Verdict
from .result import Attempt, Result

if TYPE_CHECKING:
    from .dynamic_result import DynamicAttempt, DynamicResult

OLDEST = ("plant", "spec", "inc", "certificate", "figures")
"""What every file of a result has; those written first have no more."""

EMPTY: dict[str, Any] = {"proof": None, "estimate": None, "bounds": {}, "linear": {}, "history": (), "notes": (),
                         "seconds": {}}
"""What stands for the parts of a result that such a file lacks."""


@dataclass(frozen=True, eq=False)
class SavedResult(Brief):
    """A result read from a file; `print(saved)` shows its table.

    Certificate and bounds are recomputed from their numbers whenever they are asked, as in every result. The simulated
    cost, the costs of linear competitors, times and notes are a record, and so is `result.proof`: `certificate.prove()`
    settles it anew.

    result: with attempts, bounds and notes; empty ones where an early file has none;
    figures: simulated cost, lower bounds and linear competitors, as printed when the result was made.
    """

    result: Result
    figures: Mapping[str, float]

    @property
    def plant(self) -> Plant:
        """What was controlled."""
        return self.result.plant

    @property
    def spec(self) -> Spec:
        """What was asked."""
        return self.result.spec

    @property
    def inc(self) -> INC | None:
        """The controller."""
        return self.result.inc

    @property
    def certificate(self) -> Certificate | None:
        """The certificate, which can be checked again."""
        return self.result.certificate

    @property
    def bounds(self) -> Mapping[str, Bound]:
        """The lower bounds by name, which can be checked again."""
        return self.result.bounds

    def holds(self) -> bool:
        """Whether the certificate speaks of this plant and controller and holds, checked now from its numbers."""
        return self.certificate is not None and self.certificate.holds()

    def __str__(self) -> str:
        return str(self.result)


def save_result(result: Result, path: str | Path) -> None:
    """Write a result with its certificate, bounds, attempts and notes to a JSON file."""
    parts = {field.name: getattr(result, field.name) for field in fields(Result)}
    parts |= {"history": [written(attempt) for attempt in result.history], "chosen": place_of(result),
              "figures": _figures(result)}
    save(parts, path)


def load_result(path: str | Path) -> SavedResult:
    """Return what `Result.save` wrote.

    Raises FormatError when the file is something else, or its certificate or bounds are about another plant, controller or
    specification.
    """
    parts = load(path)
    known = {field.name for field in fields(Result)} | {"figures"}
    if not isinstance(parts, dict) or not set(OLDEST) <= set(parts) <= known:
        raise FormatError(f"{path} holds no result of synthesize")
    parts = EMPTY | parts
    figures = parts.pop("figures")
    try:
        parts["history"] = tuple(_read(attempt) for attempt in parts["history"])
        place = parts.get("chosen")
        parts["chosen"] = None if place is None else parts["history"][place]
        for name in ("bounds", "linear", "seconds"):
            parts[name] = MappingProxyType(dict(parts[name]))
        saved = SavedResult(Result(**parts), figures)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise FormatError(f"{path} holds no result of synthesize: {error}") from error
    _refuse_strangers(saved, path)
    return saved


def _figures(result: Result) -> dict[str, float]:
    figures = {f"lower bound, {name}": float(bound) for name, bound in result.bounds.items()}
    figures |= dict(result.linear)
    if result.estimate is not None:
        figures |= {"simulated expected cost": result.estimate.mean, "standard error": result.estimate.standard_error}
    return {name: value for name, value in figures.items() if np.isfinite(value)}


def place_of(result: Result | DynamicResult) -> int | None:
    """Return where among the attempts the chosen one is."""
    return next((i for i, attempt in enumerate(result.history) if attempt is result.chosen), None)


def written(attempt: Attempt | DynamicAttempt) -> dict[str, Any]:
    """Return an attempt as it stands in a file: by the names of its fields, the causes of its verdict by theirs."""
    parts = {field.name: getattr(attempt, field.name) for field in fields(attempt)}
    verdict = attempt.verdict
    if verdict is not None:
        parts["verdict"] = {field.name: getattr(verdict, field.name) for field in fields(Verdict)}
        parts["verdict"]["causes"] = [cause.name for cause in verdict.causes]
    return parts


def _read(parts: Mapping[str, Any]) -> Attempt:
    verdict = parts["verdict"]
    if verdict is not None:
        verdict = Verdict(**(verdict | {"causes": tuple(Cause[name] for name in verdict["causes"])}))
    return Attempt(**(dict(parts) | {"verdict": verdict}))


def _refuse_strangers(saved: SavedResult, path: str | Path) -> None:
    if saved.certificate is not None:
        found = strange_certificate(saved.certificate, saved.plant, saved.spec, saved.inc)
        if found:
            raise FormatError(f"{path}: the certificate {found} than the file says")
        if not limits_kept([saved.certificate], saved.inc, saved.spec):
            raise FormatError(f"{path}: that the controller keeps the input limits rests on nothing")
    for name, bound in saved.bounds.items():
        found = strange_bound(bound, saved.plant, saved.spec, LINEAR if name.startswith("linear") else ANY)
        if found:
            raise FormatError(f"{path}: the lower bound {name!r} {found} than the file says")
