"""Keep a result with memory in a file and open it again with its proofs checkable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from inc_casadi import load, save
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.comparison.families import ANY, LINEAR
from inc_casadi.dynamic import DynamicINC, extended, extended_spec
from inc_casadi.errors import FormatError
from inc_casadi.interchange.agreement import strange_bound, strange_certificate
from inc_casadi.linear import ClippedCost, UnswitchedCost
from inc_casadi.output_range import within_limits

from .causes import Cause
from .dynamic_result import DynamicAttempt, DynamicResult
from .gate import Verdict
from .storage import place_of, written

_OF_EXTENDED = (MatrixCertificate, UnswitchedCost, ClippedCost)  # what speaks of the extended loop


def save_dynamic_result(result: DynamicResult, path: str | Path) -> None:
    """Write a result with its certificate, bounds, attempts and notes to a JSON file."""
    parts = {field.name: getattr(result, field.name) for field in fields(DynamicResult)}
    save(parts | {"history": [written(attempt) for attempt in result.history], "chosen": place_of(result)}, path)


def load_dynamic_result(path: str | Path) -> DynamicResult:
    """Return what `DynamicResult.save` wrote.

    Certificate and bounds are recomputed from their numbers whenever they are asked; simulated costs, times and notes are a
    record, and so is `proof`: `certificate.prove()` settles it anew.

    Raises FormatError when the file is something else, or its certificate or bounds are about another plant, controller or
    specification.
    """
    parts = load(path)
    if not isinstance(parts, dict) or set(parts) != {field.name for field in fields(DynamicResult)}:
        raise FormatError(f"{path} holds no result of synthesize_dynamic")
    try:
        history = tuple(_read(attempt) for attempt in parts["history"])
        place = parts["chosen"]
        tables = {name: MappingProxyType(dict(parts[name])) for name in ("bounds", "seconds")}
        result = DynamicResult(**(parts | tables | {"history": history, "notes": tuple(parts["notes"]),
                                                    "chosen": None if place is None else history[place]}))
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise FormatError(f"{path} holds no result of synthesize_dynamic: {error}") from error
    stranger = _stranger(result)
    if stranger:
        raise FormatError(f"{path}: {stranger} than the file says")
    return result


def _stranger(result: DynamicResult) -> str:
    """What speaks of something else than the file, or ""."""
    plant, spec, dynamic, certificate = result.plant, result.spec, result.dynamic, result.certificate
    if certificate is not None:
        if not isinstance(dynamic, DynamicINC):
            return "the certificate is about another controller"
        if isinstance(certificate, _OF_EXTENDED):  # with limits that are built in or absent
            free = spec.inputs is None or within_limits(dynamic.readout, spec.inputs)
            asked = extended_spec(replace(spec, inputs=None), dynamic)
            found = strange_certificate(certificate, *_swapped(extended(plant, dynamic), asked)) if free else (
                "is about other limits")
        else:
            found = strange_certificate(certificate, plant, spec, dynamic)
        if found:
            return f"the certificate {found}"
    for name, bound in result.bounds.items():
        found = strange_bound(bound, plant, spec, LINEAR if name.startswith("linear") else ANY)
        if found:
            return f"the lower bound {name!r} {found}"
    return ""


def _swapped(loop: tuple[Any, Any], spec: Any) -> tuple[Any, Any, Any]:
    return loop[0], spec, loop[1]


def _read(parts: Mapping[str, Any]) -> DynamicAttempt:
    verdict = parts["verdict"]
    if verdict is not None:
        words = {name: tuple(verdict[name]) for name in ("proofs", "refusals")}
        verdict = Verdict(**(verdict | words | {"causes": tuple(Cause[name] for name in verdict["causes"])}))
    return DynamicAttempt(**(dict(parts) | {"verdict": verdict, "training": tuple(map(tuple, parts["training"]))}))
