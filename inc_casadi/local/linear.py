"""The largest ellipsoid on which the law stays the linear one that it is at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..exact import solve
from ..multipliers.atoms import bends
from ..multipliers.base import Unknown
from .base import (
    LocalMethod,
    Setting,
    cost_decrease,
    decrease,
    input_rows,
    keeps_states,
    no_room,
    storage_unknowns,
    within,
)
from .dual import Dual, dual_search, dual_states

LARGEST = 40  # units of a law with feedback among them, above which eliminating in Fractions takes too long


@dataclass(frozen=True)
class Linear(LocalMethod):
    """No unit reaches a kink in the ellipsoid, so the loop is linear there: e+ = A* e, z~ = Z* e, v = G* e.

    With the slopes D of the pieces at rest, eta~ = N e where N = (I - D W)^-1 D U C is solved for in Fractions, A* = A + B K
    C + B V N, Z* = U C + W N, G* = K C + V N. Conditions: P > 0; the decrease of V along A*; |Z*_i e| < distance of z*_i
    from its kinks on the ellipsoid; input and state limits likewise; the cost along A* (a discounted Lyapunov inequality).
    Given the linear law nothing is lost: the volume is the largest of any such ellipsoid. Needs piecewise-affine units that
    do not rest on a kink, and at most 40 of them when W feeds back.

    >>> from inc_casadi import INC, Plant, Box, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.linear([[-1.0]]))
    >>> setting = Setting(loop, Attraction(Box([-1.0], [1.0])), rest_of(loop))
    >>> list(Linear().conditions(setting, {"P": np.array([[1.5]])}))
    ['P', 'decrease', 'input limit 0', 'input limit 1']
    """

    @property
    def name(self) -> str:
        """linear."""
        return "linear"

    def applies(self, setting: Setting) -> str | None:
        """Return which unit is curved or rests on a kink, or that W feeds back among too many, or a limit without room."""
        inc, rest = setting.loop.inc, setting.rest
        for i, unit in enumerate(inc.activations):
            if unit.pieces is None:
                return f"hidden unit {i} has activation {unit}, which is not piecewise affine"
            if slope_at(unit, rest.z_low[i], rest.z_high[i]) is None:
                return f"hidden unit {i} rests on a kink of {unit}, so the law is not linear around the equilibrium"
        if not is_feedforward(inc.W) and inc.q > LARGEST:
            return f"W feeds back among {inc.q} units: solving for the linear law in Fractions is done up to {LARGEST}"
        return no_room(setting)

    def unknowns(self, setting: Setting) -> tuple[Unknown, ...]:
        """Return P, and P_cost where a cost is asked for."""
        return storage_unknowns(setting)

    def conditions(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return P > 0, the decrease, the rooms and limits, and the cost."""
        A, rows, rooms, G = self._numbers(setting)
        P, eye = values["P"], np.eye(setting.loop.n)
        found = {"P": P, "decrease": decrease(setting, P, eye, A)}
        for name, row in rows.items():
            found |= within(setting, name, P, eye, row, rooms[name])
        found |= keeps_states(setting, P)
        if setting.claim.has_cost:
            cost = values["P_cost"]
            found |= {"P_cost": cost, "cost": cost_decrease(setting, cost, eye, A, G)}
        return found

    def search(self, setting: Setting) -> dict[str, Array] | str:
        """Return the P of the best ellipsoid, by one convex program in P^-1."""
        A, rows, rooms, _ = self._numbers(setting)

        def inequalities(dual: Dual, values: Mapping[str, Any]) -> dict[str, Any]:
            return {"decrease": dual.fall(setting, A @ dual.e), **dual_states(setting, dual),
                    **{name: dual.kept(row @ dual.e, rooms[name]) for name, row in rows.items()}}

        return dual_search(self, setting, (), inequalities, lambda found: {})

    def _numbers(self, setting: Setting) -> tuple[Any, dict[str, Any], dict[str, Fraction], Any]:
        """Return A*, the named rows over e that have a room, the rooms, and G*, in the arithmetic of the setting."""
        loop = setting.loop
        law = linear_law(setting)
        n = loop.n
        N = setting.number(law)
        A, G = loop.F[:, :n] + loop.F[:, n:] @ N, loop.G[:, :n] + loop.G[:, n:] @ N
        Z = loop.Z[:, :n] + loop.Z[:, n:] @ N
        rows, rooms = {}, {}
        for i, unit in enumerate(loop.inc.activations):
            found = slope_at(unit, setting.rest.z_low[i], setting.rest.z_high[i])
            if found is not None and found[1] is not None:
                rows[f"kink of unit {i}"], rooms[f"kink of unit {i}"] = Z[i: i + 1, :], found[1]
        H, limits = input_rows(setting)
        for i in range(len(limits)):
            rows[f"input limit {i}"], rooms[f"input limit {i}"] = setting.number(H[i]) @ G, limits[i]
        return A, rows, rooms, G


def slope_at(unit: Any, low: Fraction, high: Fraction) -> tuple[Fraction, Fraction | None] | None:
    """Return the slope of a unit around its rest and the distance to its nearest kink (None without), or None on a kink.

    low, high: bounds on the pre-activation at rest.

    >>> from inc_casadi import ReLU
    >>> [str(entry) for entry in slope_at(ReLU(), Fraction(2), Fraction(2))], slope_at(ReLU(), Fraction(0), Fraction(0))
    (['1', '2'], None)
    """
    kinks, slopes = bends(unit) or ([], [Fraction(0)])
    if any(low <= kink <= high for kink in kinks):
        return None
    room = min((min(abs(kink - low), abs(kink - high)) for kink in kinks), default=None)
    return slopes[sum(low > kink for kink in kinks)], room


def is_feedforward(W: Array) -> bool:
    """Return whether no unit reaches itself through W, so that W and every D W are nilpotent.

    >>> is_feedforward(np.array([[0.0, 0.0], [1.0, 0.0]])), is_feedforward(np.array([[0.5]]))
    (True, False)
    """
    reached = W != 0
    for _ in range(len(W)):
        if not reached.any():
            return True
        reached = (reached.astype(float) @ (W != 0).astype(float)) > 0
    return not reached.any()


def linear_law(setting: Setting) -> np.ndarray:
    """Return N (q, n) in Fractions with eta~ = N e as long as no unit crosses a kink: N = D (U C + W N)."""
    from ..readings import Rational
    plant, inc, rest = setting.loop.plant, setting.loop.inc, setting.rest
    if inc.q == 0:
        return np.zeros((0, plant.n), dtype=object)
    slopes = []
    for unit, low, high in zip(inc.activations, rest.z_low, rest.z_high, strict=True):
        found = slope_at(unit, low, high)
        assert found is not None
        slopes.append([found[0]])
    D = Rational.lift(np.array(slopes, dtype=object))
    direct, through = D * (Rational.lift(inc.U) @ plant.C), D * Rational.lift(inc.W)
    if not is_feedforward(inc.W):
        system = exact(np.eye(inc.q)) - through.fractions()
        columns = [solve(system, column) for column in direct.fractions().T]
        assert all(column is not None for column in columns)  # I - DW is nonsingular where the law is well posed
        return np.array(columns, dtype=object).T
    N = direct
    for _ in range(inc.q):
        N = direct + through @ N
    return N.fractions()
