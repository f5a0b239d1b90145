"""Kinked loops on a polytope around the rest: products of everything that is nonnegative there, the half-spaces included."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import vstack
from ..exact_rest import rest_point
from ..loop import ClosedLoop
from ..multipliers import Relu
from ..multipliers.atoms import parts_of
from ..multipliers.base import Unknown
from .base import (
    LocalMethod,
    Setting,
    cost_decrease,
    decrease,
    input_rows,
    keeps_states,
    no_room,
    state_rows,
    storage_unknowns,
    within,
    without_cost,
)
from .checks import is_satisfied
from .dead_zone import DeadZone
from .frames import first_frame, law_around_rest, root_of
from .lines import lines

MOST_UNITS = 12  # the products of 2q lengths with each other and with the half-spaces are some 10 q^2 unknowns
WIDTHS = (1.05, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0)  # of the region, as multiples of the units' rooms
ROUNDS = 3  # of linearizing log det P
SLACKS = (1e-8, 1e-6, 1e-4)


@dataclass(frozen=True)
class PolytopeRows(LocalMethod):
    """The complete multiplier of kinked units, with the half-spaces of a region that contains the ellipsoid among its rows.

    The region is {|F_i e| <= 1} and the state limits {r - S e >= 0}; P - F_i'F_i > 0 and the conditions of the state limits
    keep the ellipsoid in it. There 1 - F_i e, 1 + F_i e and r - S e are nonnegative, as are the lengths h (zero at rest) and
    g (not zero at rest) that pre-activations have got past kinks (`multipliers.Relu`). All are affine in the stacked
    (1, e, eta~), so products with nonnegative weights give forms that are nonnegative on the region; the half-spaces join g,
    and `Relu` pays for the linear terms h_i g*_j by its complementarities. Conditions: P > 0; rate^2 V - V+ - M > 0; input
    limits and cost with multipliers of their own.

    For a saturation, p and n its lengths past the two kinks, (near z~ - eta~)(eta~ - H e) = p (1 - H e) + n (1 + H e): with
    F_i = H_i / room_i the generalized sector of `dead_zone` is contained, and products across units come on top.

    All is linear in P and the multipliers for a given F. The search takes F and P from `dead_zone` and improves on P by
    linearizing log det P; where that finds nothing, F lies along the loop's linear law, the region being c times the units'
    rooms wide for several c. Needs a unit that rests off its kinks.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> [u.name for u in PolytopeRows().unknowns(Setting(loop, Attraction(), rest_of(loop)))]
    ['P', 'F', 'N', 'N_g', 'w']
    """

    @property
    def name(self) -> str:
        """polytope."""
        return "polytope"

    def applies(self, setting: Setting) -> str | None:
        """Return that no unit can use the region, that units are too many, or which limit leaves no room."""
        loop = setting.loop
        if not lines(setting).bent:
            return "no hidden unit with a kink rests off it, so the half-spaces of a region have no product to offer"
        if loop.q > MOST_UNITS:
            return f"{loop.q} hidden units have too many products; that is done up to {MOST_UNITS}"
        if loop.about == "difference" and rest_point(loop.plant, loop.inc) is None:
            return "the equilibrium is not known in rational arithmetic"
        return no_room(setting)

    def unknowns(self, setting: Setting) -> tuple[Unknown, ...]:
        """Return P, P_cost, F (one row per bent unit), and the unknowns of `Relu` for every inequality."""
        rows = Unknown("F", (len(lines(setting).bent), setting.loop.n), "free")
        own = Relu().unknowns(regional(setting, np.zeros(rows.shape)))
        found = [*storage_unknowns(setting), rows]
        for suffix in self._suffixes(setting):
            found += [replace(unknown, name=unknown.name + suffix) for unknown in own]
        return tuple(found)

    def conditions(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return P > 0, the decrease, the region around the ellipsoid, limits and cost."""
        P, F = values["P"], values["F"]
        wide = regional(setting, F)
        M = {suffix: Relu().matrix(wide, _own(wide, values, suffix)) for suffix in self._suffixes(setting)}
        found = {"P": P, "decrease": decrease(setting, P, wide.X, wide.F) - M[""]}
        if setting.claim.has_cost:
            drop = cost_decrease(setting, values["P_cost"], wide.X, wide.F, wide.G)
            found |= {"P_cost": values["P_cost"], "cost": drop - M["_cost"]}
        rows, rooms = input_rows(setting)
        for i in range(len(rooms)):
            kept = within(setting, f"input limit {i}", P, wide.X, setting.number(rows[i]) @ wide.G, rooms[i])
            found |= {name: entry - M[_input(i)] for name, entry in kept.items()}
        for i in range(F.shape[0]):
            found |= within(setting, f"region {i}", P, np.eye(setting.loop.n), F[i: i + 1, :], Fraction(1))
        return found | keeps_states(setting, P)

    def signs(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the signs that `Relu` asks for, for every inequality."""
        wide = regional(setting, values["F"])
        return {name + suffix: entries for suffix in self._suffixes(setting)
                for name, entries in Relu().signs(wide, _own(wide, values, suffix)).items()}

    def search(self, setting: Setting) -> dict[str, Array] | str:
        """Return the values of the best ellipsoid over several widths of the region."""
        found = DeadZone().search(without_cost(setting))
        if isinstance(found, dict):
            room = lines(setting).room
            rows = np.array([found["H"][i] / float(room[i]) for i in lines(setting).bent])
            return self._at(setting, rows, root_of(found["P"]))
        best: dict[str, Array] | None = None
        for width in WIDTHS:
            values = self._at(setting, self._region(setting, width), first_frame(setting))
            if isinstance(values, dict):
                if best is not None and setting.claim.merit(values["P"]) <= setting.claim.merit(best["P"]):
                    break
                best = values
        return best or found

    def _at(self, setting: Setting, F: Array, frame: Array) -> dict[str, Array] | str:
        """Return the best values for one region; frame: where the linearization of log det P starts."""
        best: dict[str, Array] | None = None
        reason = "the solver's numbers do not satisfy the inequalities they were found for"
        for slack in SLACKS:
            for _ in range(ROUNDS):
                found = smallest_with_cost(self, setting, F, frame, slack)
                if isinstance(found, str):
                    if "infeasible" in found:
                        return best or found  # a larger slack asks for more
                    reason = found
                    break
                frame = root_of(found["P"])
                if is_satisfied(self, setting, found):
                    best = found
            if best is not None:
                return best
        return reason

    def _region(self, setting: Setting, width: float) -> Array:
        """Return F for the region in which the linear law moves no bent unit by more than width times its room."""
        loop, found = setting.loop, lines(setting)
        Z = loop.Z[:, : loop.n] + loop.Z[:, loop.n:] @ law_around_rest(setting)
        return np.array([Z[i] / (width * float(found.room[i])) for i in found.bent])

    @staticmethod
    def _suffixes(setting: Setting) -> list[str]:
        """What the multipliers' names end in: nothing for the decrease, then for the cost and each input limit."""
        inputs = [_input(i) for i in range(len(input_rows(setting)[1]))]
        return ["", *(["_cost"] if setting.claim.has_cost else []), *inputs]


def regional(setting: Setting, F: Any) -> ClosedLoop:
    """Return the loop over the stack of `Relu`, with the region's half-spaces among the parts that are not zero at rest.

    F: (k, n) rows with |F_i e| <= 1 in the region; the state limits of the claim are half-spaces of it too.
    """
    wide = Relu().widened(setting.loop)
    parts = parts_of(wide)
    states, room = state_rows(setting)
    slabs = F @ wide.X
    rows = [parts.g, -slabs, slabs]
    rest = [parts.g_rest, np.full(2 * F.shape[0], Fraction(1), dtype=object)]
    if len(room):
        rows, rest = [*rows, -setting.number(states) @ wide.X], [*rest, room]
    count = sum(len(entries) for entries in rest[1:])
    excluded = np.hstack([parts.excluded_hg, np.zeros((parts.excluded_hg.shape[0], count), dtype=bool)])
    return replace(wide, parts=replace(parts, g=vstack(*rows), g_rest=np.concatenate(rest), excluded_hg=excluded))


def smallest_with_cost(method: LocalMethod, setting: Setting, F: Array, frame: Array,
                       slack: float) -> dict[str, Array] | str:
    """Return one convex program's values, then P_cost and its multipliers where a cost is asked for; or why not."""
    from ..lmi_attraction import cheapest, smallest
    found = smallest(method, setting, {"F": F}, frame, slack)
    if isinstance(found, str) or not setting.claim.has_cost:
        return found
    cost = cheapest(method, setting, found)
    return cost if isinstance(cost, str) else found | cost


def _input(i: int) -> str:
    return f" (input limit {i})"


def _own(wide: ClosedLoop, values: Mapping[str, Any], suffix: str) -> dict[str, Any]:
    """Return the multiplier's values of one inequality under the multiplier's own names."""
    return {unknown.name: values[unknown.name + suffix] for unknown in Relu().unknowns(wide)}
