"""Are the conditions of a local method met? In floats with every rounding bounded, or in exact arithmetic."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import exact
from ..activations.stack import lipschitz, slopes
from ..arrays import Array
from ..definite import definiteness, is_surely_positive
from ..inc import INC
from ..monotone import condition as monotone_condition
from ..monotone import lmi_well_posed
from ..readings import Rational, Rounded
from .base import LocalMethod, Setting


def lifted(values: Mapping[str, Array], kind: Any) -> dict[str, Any]:
    """Return values in another arithmetic."""
    return {name: kind.lift(value) for name, value in values.items()}


def rounded_conditions(method: LocalMethod, setting: Setting, values: Mapping[str, Array]) -> dict[str, Rounded]:
    """Return the conditions with a bound on every rounding error."""
    with np.errstate(over="ignore", invalid="ignore"):
        return method.conditions(setting.read(Rounded), lifted(values, Rounded))


def exact_conditions(method: LocalMethod, setting: Setting, values: Mapping[str, Array]) -> dict[str, Rational]:
    """Return the conditions without any rounding."""
    return method.conditions(setting.read(Rational), lifted(values, Rational))


def is_satisfied(method: LocalMethod, setting: Setting, values: Mapping[str, Array]) -> bool:
    """Return whether floats with every rounding bounded show that all conditions hold; False leaves it open."""
    if not signs_hold(method, setting, values, exactly=False):
        return False
    return all(is_surely_positive(entry) for entry in rounded_conditions(method, setting, values).values())


def signs_hold(method: LocalMethod, setting: Setting, values: Mapping[str, Array], *, exactly: bool) -> bool:
    """Return whether what must be nonnegative is; not exactly: False may mean that rounding leaves it open."""
    if any(np.any(values[unknown.name][unknown.signed] < 0) for unknown in method.unknowns(setting)):
        return False
    if exactly:
        found = method.signs(setting.read(Rational), lifted(values, Rational))
        return all(entry >= 0 for matrix in found.values() for entry in matrix.fractions().flat)
    with np.errstate(over="ignore", invalid="ignore"):
        rounded = method.signs(setting.read(Rounded), lifted(values, Rounded))
    return all(bool(np.all(matrix.value - matrix.error >= 0)) for matrix in rounded.values())


def first_failing(method: LocalMethod, setting: Setting, values: Mapping[str, Array]) -> str:
    """Return what fails in exact arithmetic, or an empty string."""
    if not signs_hold(method, setting, values, exactly=True):
        return "an entry that must be nonnegative is negative"
    for name, entry in exact_conditions(method, setting, values).items():
        if not exact.is_positive_definite(entry.numbers):
            return f"the condition {name!r} is not positive definite"
    return ""


def decided(rounded: Rounded, exactly: Any) -> bool:
    """Decide one condition: in floats where that is enough, in the exact reading that `exactly()` gives otherwise."""
    verdict = definiteness(rounded)
    return exact.is_positive_definite(exactly().numbers) if verdict is None else verdict


def posed_margin(inc: INC, T: Array | None) -> float:
    """Return 1 - the contraction rate, or the monotonicity under a stored T; positive if and only if it is proved.

    T (q,): None where Perron-Frobenius decides (`certificate.posed_unknowns`).

    >>> posed_margin(INC.saturated([[2.0]], 1.0), None)
    1.0
    """
    if T is None:
        estimate = 1.0 - inc.contraction.rate
        proved = exact.contracts(lipschitz(inc.activations), inc.W, inc.contraction.weights)
    else:
        ends, root = slopes(inc.activations), 1.0 / np.sqrt(np.where(T > 0, T, 1.0))
        estimate = float(np.linalg.eigvalsh(monotone_condition(ends, inc.W, T) * np.outer(root, root))[0])
        proved = lmi_well_posed(ends, inc.W, T, False) or lmi_well_posed(ends, inc.W, T, True)
    return max(estimate, np.finfo(float).tiny) if proved else min(estimate, 0.0)
