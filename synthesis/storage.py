"""Keep a result in a file and open it again with its proof checkable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from inc_casadi import INC, Plant, Spec, load, save
from inc_casadi.certificate import Certificate
from inc_casadi.errors import FormatError

if TYPE_CHECKING:
    from .result import Result


@dataclass(frozen=True, eq=False)
class SavedResult:
    """A result read from a file: the nouns, the certificate that can be checked again, and figures as they were then.

    figures: simulated cost, lower bounds and linear competitors, as printed when the result was made; they are a
    record and prove nothing.
    """

    plant: Plant
    spec: Spec
    inc: INC | None
    certificate: Certificate | None
    figures: Mapping[str, float]

    def holds(self) -> bool:
        """Whether the certificate speaks of this plant and controller and holds, checked now from its numbers."""
        return self.certificate is not None and self.certificate.holds()


def save_result(result: Result, path: str | Path) -> None:
    """Write plant, specification, controller, certificate and figures to a JSON file."""
    figures = {f"lower bound, {name}": float(bound) for name, bound in result.bounds.items()}
    figures |= dict(result.linear)
    if result.estimate is not None:
        figures |= {"simulated expected cost": result.estimate.mean, "standard error": result.estimate.standard_error}
    save({"plant": result.plant, "spec": result.spec, "inc": result.inc, "certificate": result.certificate,
          "figures": {name: value for name, value in figures.items() if np.isfinite(value)}}, path)


def load_result(path: str | Path) -> SavedResult:
    """Return what `Result.save` wrote.

    Raises FormatError when the file is something else, or its certificate is about another plant or controller.
    """
    parts = load(path)
    if not isinstance(parts, dict) or set(parts) != {"plant", "spec", "inc", "certificate", "figures"}:
        raise FormatError(f"{path} holds no result of synthesize")
    saved = SavedResult(**parts)
    if saved.certificate is not None and not _same(saved):
        raise FormatError(f"{path}: the certificate is about another plant or controller than the file says")
    return saved


def _same(saved: SavedResult) -> bool:
    certificate = saved.certificate
    pairs = [(getattr(certificate.plant, name), getattr(saved.plant, name)) for name in ("A", "B", "C")]  # type: ignore
    if saved.inc is None:
        return False
    pairs += [(getattr(certificate.inc, name), getattr(saved.inc, name))  # type: ignore[union-attr]
              for name in ("W", "U", "V", "K", "b", "d")]
    same_units = certificate.inc.activations == saved.inc.activations  # type: ignore[union-attr]
    return same_units and all(np.array_equal(left, right) for left, right in pairs)
