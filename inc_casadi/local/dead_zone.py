"""Saturated loops with hidden feedback, by sectors that hold where the ellipsoid keeps an auxiliary law small."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import diag, he, hstack
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
)
from .convex_hull import bending
from .dual import Dual, dual_rooms, dual_search, dual_states
from .lines import Lines, diagonal, keeps_room, lines


@dataclass(frozen=True)
class DeadZone(LocalMethod):
    """Generalized sectors: between a unit and its two lines, one weight each, for any W (Gomes da Silva and Tarbouriech).

    By `lines.Lines`, where |H_i e| <= room_i, eta~_i lies between near_i z~_i and far_i z~_i + bend_i H_i e, so for every
    diagonal Lambda >= 0

        s'M s = 2 (eta~ - far z~ - bend H e)'Lambda (near z~ - eta~) >= 0,

    z~ = Z s with W included. Conditions over s = (e, eta~): P > 0; rate^2 V - V+ - M > 0; the rooms r_i^2 P - H_i'H_i > 0;
    input limits room^2 V - (row v)^2 - M_u > 0 and the cost with multipliers of their own. One weight per unit is weaker
    than the convex hull for several saturated inputs and as strong for one; its size grows with q, not with 2^q.

    The search: with psi = near z~ - eta~ for eta~ (I - W near is nonsingular where the law is well posed), X = P^-1, Y = H X
    and S = Lambda^-1 everything is linear; input limits take Lambda_u = room^2 Lambda there.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> values = {"P": np.array([[1.0]]), "H": np.array([[-0.9]]), "Lambda": np.array([3.0])}
    >>> list(DeadZone().conditions(Setting(loop, Attraction(), rest_of(loop)), values))
    ['P', 'decrease', 'room of unit 0']
    """

    @property
    def name(self) -> str:
        """dead zone."""
        return "dead zone"

    def applies(self, setting: Setting) -> str | None:
        """Return which limit leaves no room."""
        return no_room(setting)

    def unknowns(self, setting: Setting) -> tuple[Unknown, ...]:
        """Return P, P_cost, H, and Lambda (q,) for the decrease, for the cost, and one row for each input limit."""
        q, limits = setting.loop.q, len(input_rows(setting)[1])
        found = [*storage_unknowns(setting), bending(setting, lines(setting)), Unknown("Lambda", (q,), "nonnegative")]
        if setting.claim.has_cost:
            found.append(Unknown("Lambda_cost", (q,), "nonnegative"))
        return (*found, *((Unknown("Lambda_inputs", (limits, q), "nonnegative"),) if limits else ()))

    def conditions(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return P > 0, the decrease, the cost, the input limits, the rooms and the state limits."""
        loop, found_lines, P, H = setting.loop, lines(setting), values["P"], values["H"]

        def sector(weights: Any) -> Any:
            return sector_between(setting, found_lines, H, weights)

        found = {"P": P, "decrease": decrease(setting, P, loop.X, loop.F) - sector(values["Lambda"])}
        if setting.claim.has_cost:
            cost = values["P_cost"]
            drop = cost_decrease(setting, cost, loop.X, loop.F, loop.G)
            found |= {"P_cost": cost, "cost": drop - sector(values["Lambda_cost"])}
        rows, rooms = input_rows(setting)
        for i in range(len(rooms)):
            row = setting.number(rows[i]) @ loop.G
            kept = setting.number(rooms[i] ** 2) * (loop.X.T @ P @ loop.X) - row.T @ row
            found[f"input limit {i}"] = kept - sector(values["Lambda_inputs"][i])
        return found | keeps_room(setting, found_lines, P, H) | keeps_states(setting, P)

    def search(self, setting: Setting) -> dict[str, Array] | str:
        """Return the values of the best ellipsoid, by one convex program in X = P^-1, Y = H X and S = Lambda^-1."""
        found_lines, (rows, rooms) = lines(setting), input_rows(setting)
        n, q = setting.loop.n, setting.loop.q
        Z, F, G = _over_psi(setting, found_lines)
        gap, bend = (diagonal(setting, part) for part in (found_lines.near - found_lines.far, found_lines.bend))

        def inequalities(dual: Dual, values: Mapping[str, Any]) -> dict[str, Any]:
            Y, S = values["H"], values["S"]

            def hat(matrix: Any) -> Any:
                return matrix @ dual.e if q == 0 else hstack(matrix[:, :n] @ dual.e, matrix[:, n:] @ diag(S))

            if q:
                dual = replace(dual, S=S, sector=gap @ hat(Z) - hstack(bend @ Y, diag(S)))
            found = {"decrease": dual.fall(setting, hat(F)), **dual_states(setting, dual)}
            found |= dual_rooms(found_lines, dual, Y)
            for i in range(len(rooms)):
                found[f"input limit {i}"] = dual.kept(hat(rows[i: i + 1] @ G), rooms[i])
            return found

        def recover(found: Mapping[str, Array]) -> dict[str, Array]:
            weights = 1.0 / found["S"] if q else np.zeros(0)
            values = {"H": found["H"] @ found["frame"].T @ found["P"], "Lambda": weights}
            return values | ({"Lambda_inputs": np.outer((rooms**2).astype(float), weights)} if len(rooms) else {})

        variables = (bending(setting, found_lines), Unknown("S", (q,), "nonnegative"))
        return dual_search(self, setting, variables, inequalities, recover)


def _over_psi(setting: Setting, found: Lines) -> tuple[Array, Array, Array]:
    """Return the rows of z~, e+ and v over (e, psi), where psi = near z~ - eta~ and so (I - W near) z~ = U C e - W psi."""
    loop = setting.loop
    n, q, near = loop.n, loop.q, diagonal(setting, found.near)
    Z = np.linalg.solve(np.eye(q) - loop.Z[:, n:] @ near, np.hstack([loop.Z[:, :n], -loop.Z[:, n:]]))
    eta = near @ Z - np.eye(q, n + q, n)
    F, G = (rows[:, :n] @ np.eye(n, n + q) + rows[:, n:] @ eta for rows in (loop.F, loop.G))
    return Z, F, G


def sector_between(setting: Setting, found: Lines, H: Any, weights: Any) -> Any:
    """Return M with s'M s = 2 (eta~ - far z~ - bend H e)'Lambda (near z~ - eta~), >= 0 where |H_i e| <= room_i."""
    loop = setting.loop
    far = loop.H - diagonal(setting, found.far) @ loop.Z - diagonal(setting, found.bend) @ H @ loop.X
    near = diagonal(setting, found.near) @ loop.Z - loop.H
    return he(far.T @ diag(weights) @ near)
