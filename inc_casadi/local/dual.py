"""The inequalities of an ellipsoid in X = P^-1, where the search for it is convex."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import diag, he, hstack, vstack
from ..multipliers.base import Unknown
from .base import LocalMethod, Setting, state_rows
from .checks import is_satisfied
from .frames import first_frame, root_of
from .lines import Lines

SLACKS = (1e-9, 1e-7, 1e-5, 1e-3)  # shares of each inequality that are given away, so that rounding cannot undo it
REPEATED = 30  # states and units up to which a search is repeated in the frame that it has found, for the last digits


@dataclass(frozen=True, eq=False)
class Dual:
    """Quadratic forms over (f, g), where e = frame X f and psi = S g, X = (frame'P frame)^-1, S = Lambda^-1.

    The congruence makes what is bilinear in (P, Lambda, H) linear: e'P e becomes f'X f, psi'Lambda psi becomes g'S g, H e
    becomes Y f with Y = H frame X. frame (n, n): columns of the size of the ellipsoid, so that X is near I. S (q,) and
    sector, rows w (q, n + q) with psi'Lambda w(e, psi) >= 0 on the graph, are None where there is no psi. Of each form
    slack (e'P e + psi'Lambda psi) is given away.
    """

    X: Any
    frame: Array
    slack: float
    S: Any = None
    sector: Any = None

    @property
    def e(self) -> Any:
        """The rows of e over f."""
        return self.frame @ self.X

    def fall(self, setting: Setting, step: Any) -> Any:
        """Return what is >= 0 when V decreases; step: rows of e+ (or de/dt) over (f, g). Schur's complement takes V+."""
        rate, n = setting.claim.rate, self.X.shape[0]
        step = np.linalg.inv(self.frame) @ step
        if setting.loop.plant.discrete:
            return _bordered(self._base(1.0 if rate is None else rate**2), step, self.X)
        rest = step.shape[1] - n
        flow = step if rest == 0 else vstack(step, np.zeros((rest, n + rest)))
        return self._base(0.0 if rate is None else -rate) - he(flow)

    def kept(self, row: Any, room: Any) -> Any:
        """Return what is >= 0 when |row| <= room in the ellipsoid; row (1, n) over f or (1, n + q) over (f, g)."""
        base = self.X if row.shape[1] == self.X.shape[0] else self._base(1.0)
        return _bordered(base, row / float(room), np.eye(1) * (1.0 - self.slack))

    def _base(self, share: float) -> Any:
        """Return share X - He(g'sector) less the slack."""
        if self.S is None:
            return (share - self.slack) * self.X
        n, q = self.X.shape[0], self.S.shape[0]
        top = hstack((share - self.slack) * self.X, np.zeros((n, q)))
        bottom = hstack(np.zeros((q, n)), -self.slack * diag(self.S))
        return vstack(top, bottom) - he(vstack(np.zeros((n, n + q)), self.sector))


def _bordered(base: Any, rows: Any, corner: Any) -> Any:
    return vstack(hstack(base, rows.T), hstack(rows, corner))


def dual_states(setting: Setting, dual: Dual) -> dict[str, Any]:
    """Return the matrices that are >= 0 when the ellipsoid lies within the state limits."""
    rows, rooms = state_rows(setting)
    return {f"state limit {i}": dual.kept(rows[i: i + 1] @ dual.e, rooms[i]) for i in range(len(rooms))}


def dual_rooms(found: Lines, dual: Dual, Y: Any) -> dict[str, Any]:
    """Return the matrices that are >= 0 when |H_i e| <= room_i in the ellipsoid for every bent unit; H e = Y f."""
    return {f"room of unit {i}": dual.kept(Y[i: i + 1, :], found.room[i]) for i in found.bent}


Inequalities = Callable[[Dual, Mapping[str, Any]], dict[str, Any]]
Recovery = Callable[[Mapping[str, Array]], dict[str, Array]]


def dual_search(method: LocalMethod, setting: Setting, variables: tuple[Unknown, ...], inequalities: Inequalities,
                recover: Recovery) -> dict[str, Array] | str:
    """Return the values of the best ellipsoid that pass the method's own conditions, or why there are none.

    variables: what is searched for besides X; inequalities: the named matrices that must be >= 0, from the dual and the
    variables; recover: the method's values other than P, from "P", "frame" and the variables. P_cost and its multipliers are
    found afterwards, with all others fixed. A larger slack is tried until the rounded conditions hold.
    """
    frame, reason = first_frame(setting), ""
    for slack in SLACKS:
        values = _found(setting, variables, inequalities, recover, frame, slack)
        if isinstance(values, str):
            reason = reason or values
            if "infeasible" in values:
                break  # a larger slack asks for more
            continue
        frame = root_of(values["P"])
        once = setting.loop.n + setting.loop.q > REPEATED
        again = [] if once else [_found(setting, variables, inequalities, recover, frame, slack)]
        for candidate in (*again, values):
            complete = candidate if isinstance(candidate, str) else _with_cost(method, setting, candidate)
            if isinstance(complete, str):
                reason = reason or complete
            elif is_satisfied(method, setting, complete):
                return complete
    return reason or "the solver's numbers do not satisfy the inequalities they were found for"


def _found(setting: Setting, variables: tuple[Unknown, ...], inequalities: Inequalities, recover: Recovery, frame: Array,
           slack: float) -> dict[str, Array] | str:
    """Return P and the method's values for one frame and slack, or the solver's reason."""
    from ..lmi_attraction import largest

    def formed(X: Any, values: Mapping[str, Any]) -> dict[str, Any]:
        return inequalities(Dual(X, frame, slack), values)

    numbers = largest(setting, variables, formed, frame)
    if isinstance(numbers, str):
        return numbers
    back = np.linalg.inv(frame)
    P = back.T @ np.linalg.inv(numbers["X"]) @ back
    P = (P + P.T) / 2
    return {"P": P, **recover({**numbers, "P": P, "frame": frame})}


def _with_cost(method: LocalMethod, setting: Setting, values: dict[str, Array]) -> dict[str, Array] | str:
    """Return the values with P_cost and its multipliers where a cost is asked for, or why there are none."""
    from ..lmi_attraction import cheapest
    if not setting.claim.has_cost:
        return values
    cost = cheapest(method, setting, values)
    return cost if isinstance(cost, str) else values | cost
