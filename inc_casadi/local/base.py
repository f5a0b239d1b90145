"""What a local method promises: inequalities from which the claim of an ellipsoid of attraction follows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..arrays import Array
from ..claims.attraction import Attraction
from ..loop import ClosedLoop
from ..multipliers.base import Unknown, constant
from ..output_range import within_limits
from ..reading import Reading
from .rest import Rest


@dataclass(frozen=True, eq=False)
class Setting:
    """A loop, as read in some arithmetic, with the claim about it and the equilibrium that deviations are counted from.

    The stacked s = (e, eta~) holds deviations from rest; F, G, Z, X, H of the loop map it as they map (x, eta). Between eta~
    and z~ hold the bounds `loop.lower` and `loop.upper` of the loop: sectors about the origin, slopes about any other rest.
    """

    loop: ClosedLoop
    claim: Attraction
    rest: Rest

    def read(self, kind: Any) -> Setting:
        """Return the setting with the loop's matrices formed anew in another arithmetic (`readings.Reading`)."""
        return replace(self, loop=self.loop.read(kind))

    def number(self, value: Any) -> Any:
        """Return floats or Fractions, as a matrix, in the arithmetic of the loop; one number becomes 1 x 1, or a float."""
        if not isinstance(self.loop.F, Reading) and np.ndim(value) == 0:
            return float(value)  # CVXPY takes the product of two 1 x 1 matrices for one of matrices
        array = np.atleast_2d(np.asarray(value))
        if array.dtype != object:
            return constant(self.loop, array.astype(float))
        fractions = np.array([Fraction(entry) for entry in array.flat], dtype=object).reshape(array.shape)
        return constant(self.loop, fractions)


def without_cost(setting: Setting) -> Setting:
    """Return the setting with a claim that asks for no bound on the cost."""
    return replace(setting, claim=replace(setting.claim, Q=None, R=None))


class LocalMethod(ABC):
    """A way to prove an `Attraction`: unknowns, inequalities, and a search for values that satisfy them.

    The theorem behind a method reads: if the controller is well posed, `applies` names nothing, every signed entry of
    `unknowns` and every entry of `signs` is nonnegative and every matrix of `conditions` is positive definite, then the
    claim is true of the ellipsoid {e'P e <= 1} around `Setting.rest`. Conditions are written with `@ + - * .T` and `blocks`
    over the matrices of the setting, so that floats, rounding bounds and exact fractions read the same text; a search may
    use other variables, since only its values count.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """The word that selects the method."""

    @abstractmethod
    def applies(self, setting: Setting) -> str | None:
        """Return why the method cannot prove the claim about this loop, or None."""

    @abstractmethod
    def unknowns(self, setting: Setting) -> tuple[Unknown, ...]:
        """Return the numbers of a certificate: P first, "P_cost" where a cost is asked for, then the method's own."""

    @abstractmethod
    def conditions(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the named symmetric matrices that must be positive definite, in the arithmetic of setting and values."""

    def signs(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return named matrices whose entries must be nonnegative, besides signed unknowns."""
        return {}

    @abstractmethod
    def search(self, setting: Setting) -> dict[str, Array] | str:
        """Return values for the unknowns, as good as they are found, or the reason why there are none; floats only."""


def storage_unknowns(setting: Setting) -> tuple[Unknown, ...]:
    """Return P, and P_cost where a cost is asked for, both (n, n)."""
    n = setting.loop.n
    names = ("P", "P_cost") if setting.claim.has_cost else ("P",)
    return tuple(Unknown(name, (n, n), "symmetric") for name in names)


def decrease(setting: Setting, P: Any, X: Any, F: Any) -> Any:
    """Return rate^2 V - V+ in discrete time, -dV/dt - rate V in continuous time, V = e'P e, as a quadratic form.

    X, F: e = X s and e+ = F s (or de/dt = F s). Without a rate: V - V+, -dV/dt.
    """
    rate = setting.claim.rate
    now = X.T @ P @ X
    if setting.loop.plant.discrete:
        kept = now if rate is None else setting.number(Fraction(rate) ** 2) * now
        return kept - F.T @ P @ F
    flow = X.T @ P @ F
    fall = -(flow + flow.T)
    return fall if rate is None else fall - setting.number(Fraction(rate)) * now


def cost_decrease(setting: Setting, P: Any, X: Any, F: Any, G: Any) -> Any:
    """Return V - discount V+ - e'Qe - v'Rv with V = e'P e (P = P_cost) as a quadratic form; e = X s, e+ = F s, v = G s."""
    claim = setting.claim
    Q, R = setting.number(claim.Q), setting.number(claim.R)
    ahead = setting.number(Fraction(claim.discount)) * (F.T @ P @ F)
    return X.T @ P @ X - ahead - X.T @ Q @ X - G.T @ R @ G


def input_rows(setting: Setting) -> tuple[Array, np.ndarray]:
    """Return the limits on v = u - u* that are still to be proved: H v <= room, H (k, m), room (k,) Fractions.

    None are left when the range of the activations keeps every input within them (`output_range.within_limits`).
    """
    inputs, inc = setting.claim.inputs, setting.loop.inc
    if inputs is None or within_limits(inc, inputs):
        return np.zeros((0, inc.m)), np.zeros(0, dtype=object)
    return inputs.H, setting.rest.input_room(inputs.H, inputs.h)


def state_rows(setting: Setting) -> tuple[Array, np.ndarray]:
    """Return the limits on e = x - x*: H e <= room, H (k, n), room (k,) Fractions."""
    states = setting.claim.states
    if states is None:
        return np.zeros((0, setting.loop.n)), np.zeros(0, dtype=object)
    return states.H, setting.rest.state_room(states.H, states.h)


def no_room(setting: Setting) -> str | None:
    """Return which limit the equilibrium touches or violates, or None: no ellipsoid around it can keep that one."""
    for what, (_, rooms) in (("input", input_rows(setting)), ("state", state_rows(setting))):
        for i in range(len(rooms)):
            if rooms[i] <= 0:
                return f"the equilibrium leaves no room to {what} limit number {i}: h - H {what[0]}* = {float(rooms[i]):.6g}"
    return None


def within(setting: Setting, name: str, P: Any, X: Any, row: Any, room: Any) -> dict[str, Any]:
    """Return the condition that |row s| < room wherever e'P e <= 1: room^2 X'PX - row'row > 0.

    (row s)^2 < room^2 e'P e, so at most room^2 in the ellipsoid. row: (1, width), in the setting's arithmetic; room: a
    Fraction.
    """
    return {name: setting.number(Fraction(room) ** 2) * (X.T @ P @ X) - row.T @ row}


def keeps_states(setting: Setting, P: Any) -> dict[str, Any]:
    """Return the conditions that the ellipsoid lies within the state limits, one for each half-space."""
    rows, rooms = state_rows(setting)
    eye = np.eye(setting.loop.n)
    found: dict[str, Any] = {}
    for i in range(len(rooms)):
        found |= within(setting, f"state limit {i}", P, eye, setting.number(rows[i]), rooms[i])
    return found
