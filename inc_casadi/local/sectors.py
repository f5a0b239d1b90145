"""Loops with any hidden units, tanh and ReLU nets above all, by the sectors that hold on the range an ellipsoid allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..arrays import Array
from ..multipliers.base import Unknown
from ..readings import Rational, Rounded
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
from .convex_hull import bending
from .dead_zone import sector_between
from .lines import keeps_room, lines
from .unit_bounds import linearized, local_lines


@dataclass(frozen=True)
class LocalSectors(LocalMethod):
    """Sectors on the range |z~_i| <= r_i that each hidden unit keeps to in the ellipsoid (Yin, Seiler, Arcak, made general).

    Of r, P and the controller follow, all recomputed here:

    * for each i a row g_i and a number slack_i with |z~_i| <= |g_i e| + slack_i as long as the bounds r hold
      (`unit_bounds.linearized`); the conditions room_i^2 P - g_i'g_i > 0 and room_i = r_i - slack_i >= 0 then prove the
      bounds r for all of the ellipsoid, W != 0 included;
    * sectors a_i z~_i, b_i z~_i of eta~_i on those ranges, as each activation states them (`Activation.sector_on`),
      narrower than the global ones: for tanh around 0, a_i = tanh(r_i) / r_i;
    * s'M s = 2 (eta~ - a z~)'Lambda (b z~ - eta~) >= 0 for every Lambda >= 0 over s = (e, eta~), and so the decrease
      rate^2 V - V+ - M > 0 of V = e'P e; cost and input limits likewise, with multipliers of their own.

    r_i = 0 leaves unit i unbounded, with its global slopes. A saturating or kinked unit may instead, by a row H_i that is
    not zero, have the bent lines of `lines.Lines`: for the last saturation of a net they reach further than a sector.

    Any activation, any W that is well posed, discrete and continuous time. Sufficient.

    programs: the most convex programs that each mode of the search may solve after it has a first ellipsoid; nothing else
    depends on it.

    >>> from inc_casadi import INC, Plant, Tanh, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.2]], [[1.0]]), INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()))
    >>> values = {"P": np.array([[0.4]]), "H": np.zeros((1, 1)), "Lambda": np.array([2.0]), "r": np.array([1.7])}
    >>> list(LocalSectors().conditions(Setting(loop, Attraction(), rest_of(loop)), values))
    ['P', 'decrease', 'bound of unit 0']
    """

    programs: int = 60

    @property
    def name(self) -> str:
        """local sectors."""
        return "local sectors"

    def applies(self, setting: Setting) -> str | None:
        """Return which limit leaves no room."""
        return no_room(setting)

    def unknowns(self, setting: Setting) -> tuple[Unknown, ...]:
        """Return P, P_cost, H (q, n), r (q,), and Lambda (q,) for the decrease, the cost, and one row per input limit."""
        q, limits = setting.loop.q, len(input_rows(setting)[1])
        found = [*storage_unknowns(setting), bending(setting, lines(setting)), Unknown("r", (q,), "nonnegative"),
                 Unknown("Lambda", (q,), "nonnegative")]
        if setting.claim.has_cost:
            found.append(Unknown("Lambda_cost", (q,), "nonnegative"))
        return (*found, *((Unknown("Lambda_inputs", (limits, q), "nonnegative"),) if limits else ()))

    def conditions(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return P > 0, the decrease, the cost, the input limits, the bounds of units, the rooms and the state limits."""
        loop, P, H = setting.loop, values["P"], values["H"]
        r = numbers(values["r"])
        around = local_lines(setting, r, numbers(H))

        def sector(weights: Any) -> Any:
            return sector_between(setting, around, H, weights)

        found = {"P": P, "decrease": decrease(setting, P, loop.X, loop.F) - sector(values["Lambda"])}
        if setting.claim.has_cost:
            cost = values["P_cost"]
            found |= {"P_cost": cost,
                      "cost": cost_decrease(setting, cost, loop.X, loop.F, loop.G) - sector(values["Lambda_cost"])}
        rows, limits = input_rows(setting)
        for i in range(len(limits)):
            row = setting.number(rows[i]) @ loop.G
            kept = setting.number(limits[i] ** 2) * (loop.X.T @ P @ loop.X) - row.T @ row
            found[f"input limit {i}"] = kept - sector(values["Lambda_inputs"][i])
        bounds = linearized(setting, r, numbers(P))
        g, rooms = bounds.rows(loop.Z[:, : loop.n]), bounds.rooms(r)
        for i in np.flatnonzero(r > 0).tolist():
            found |= within(setting, f"bound of unit {i}", P, np.eye(loop.n), g[i: i + 1, :], Fraction(rooms[i]))
        return found | keeps_room(setting, around, P, H) | keeps_states(setting, P)

    def signs(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rooms of the bounded units: a bound that holds for no ellipsoid has the room -1."""
        r = numbers(values["r"])
        if not np.any(r > 0):
            return {}
        return {"room of the bounds": setting.number(linearized(setting, r, numbers(values["P"])).rooms(r)[r > 0])}

    def search(self, setting: Setting) -> dict[str, Array] | str:
        """Return the values of the best ellipsoid, by a search over r with one convex program for each."""
        from ..lmi_local_sectors import largest
        return largest(setting, self.programs)


def numbers(value: Any) -> Array:
    """Return the floats that a value stands for, in whatever arithmetic it is read.

    >>> numbers(Rational.lift(np.array([0.5]))).tolist(), numbers(Rounded.lift(np.array([0.5]))).tolist()
    ([0.5], [0.5])
    """
    if isinstance(value, Rational):
        return np.array(value.fractions(), dtype=float)
    return value.value if isinstance(value, Rounded) else np.asarray(value, dtype=float)
