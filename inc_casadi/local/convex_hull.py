"""Saturated laws by convex hulls: the loop is a mixture of 2^q linear ones, and all of them share a Lyapunov function."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from ..arrays import Array
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
from .dual import Dual, dual_rooms, dual_search, dual_states
from .lines import Lines, diagonal, keeps_room, lines

MOST_UNITS = 8  # 2^8 inequalities


@dataclass(frozen=True)
class ConvexHull(LocalMethod):
    """For W = 0: each unit is a mixture of its two lines, so the loop is a mixture of 2^q linear loops (Hu and Lin).

    By `lines.Lines`, where |H_i e| <= room_i, the unit eta~_i lies between near_i U_i C e and far_i U_i C e + bend_i H_i e.
    So the vector eta~ is a convex combination of the 2^q vectors N_D e that take the first line for the units in D and the
    second for the others, and e+ = sum lambda_D A_D e, v = sum lambda_D G_D e. V and the stage cost are convex, so
    inequalities along every A_D, G_D bound them along the loop; a limit holds for the mixture when it holds for each. For
    one saturated input this is lossless among quadratic V (Hu, Lin, Chen 2002). H (q, n) is stored; the search is convex in
    X = P^-1 and Y = H X.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> values = {"P": np.array([[1.0]]), "H": np.array([[-0.9]])}
    >>> found = ConvexHull().conditions(Setting(loop, Attraction(), rest_of(loop)), values)
    >>> [round(float(matrix[0, 0]), 4) for matrix in found.values()]
    [1.0, 0.75, 0.64, 0.19]
    """

    @property
    def name(self) -> str:
        """convex hull."""
        return "convex hull"

    def applies(self, setting: Setting) -> str | None:
        """Return that W is not zero or the units are too many, or which limit leaves no room."""
        inc = setting.loop.inc
        if inc.W.any():
            return "convex-hull conditions are written for W = 0, and W has an entry that is not zero"
        if inc.q > MOST_UNITS:
            return f"{inc.q} hidden units give 2^{inc.q} inequalities; that is done up to {MOST_UNITS}"
        return no_room(setting)

    def unknowns(self, setting: Setting) -> tuple[Unknown, ...]:
        """Return P, P_cost and H, whose rows vanish for units that have only global bounds."""
        return (*storage_unknowns(setting), bending(setting, lines(setting)))

    def conditions(self, setting: Setting, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return P > 0, the decrease and the cost along each linear loop, the rooms and the limits."""
        found_lines, P, H = lines(setting), values["P"], values["H"]
        eye = np.eye(setting.loop.n)
        found = {"P": P}
        if setting.claim.has_cost:
            found["P_cost"] = values["P_cost"]
        rows, rooms = input_rows(setting)
        for name, N in vertices(setting, found_lines, eye, H).items():
            A, G = loop_with(setting, eye, N)
            found[f"decrease {name}"] = decrease(setting, P, eye, A)
            if setting.claim.has_cost:
                found[f"cost {name}"] = cost_decrease(setting, values["P_cost"], eye, A, G)
            for i in range(len(rooms)):
                found |= within(setting, f"input limit {i} {name}", P, eye, setting.number(rows[i]) @ G, rooms[i])
        return found | keeps_room(setting, found_lines, P, H) | keeps_states(setting, P)

    def search(self, setting: Setting) -> dict[str, Array] | str:
        """Return P and H of the best ellipsoid, by one convex program in X = P^-1 and Y = H X."""
        found_lines = lines(setting)
        rows, rooms = input_rows(setting)

        def inequalities(dual: Dual, values: Mapping[str, Any]) -> dict[str, Any]:
            Y = values["H"]
            found = dual_states(setting, dual) | dual_rooms(found_lines, dual, Y)
            for name, NX in vertices(setting, found_lines, dual.e, Y).items():
                AX, GX = loop_with(setting, dual.e, NX)
                found[f"decrease {name}"] = dual.fall(setting, AX)
                for i in range(len(rooms)):
                    found[f"input limit {i} {name}"] = dual.kept(rows[i: i + 1] @ GX, rooms[i])
            return found

        return dual_search(self, setting, (bending(setting, found_lines),), inequalities,
                           lambda found: {"H": found["H"] @ found["frame"].T @ found["P"]})


def bending(setting: Setting, found: Lines) -> Unknown:
    """Return the unknown H (q, n), with zero rows for the units that are not bent."""
    zero = np.ones((setting.loop.q, setting.loop.n), dtype=bool)
    zero[found.bent] = False
    return Unknown("H", zero.shape, "free", zero=zero)


def vertices(setting: Setting, found: Lines, X: Any, HX: Any) -> dict[str, Any]:
    """Return N_D X for each choice D of lines, named by it ("near" as 1, "far" as 0); HX stands for H X, X (n, n)."""
    loop = setting.loop
    if loop.q == 0:
        return {"": setting.number(np.zeros((0, loop.n))) @ X}
    Z = loop.Z[:, : loop.n]
    near = diagonal(setting, found.near) @ Z @ X
    far = diagonal(setting, found.far) @ Z @ X + diagonal(setting, found.bend) @ HX
    named = {}
    for choice in product((1.0, 0.0), repeat=loop.q):
        D = np.diag(choice)
        named["".join(str(int(entry)) for entry in choice)] = D @ near + (np.eye(loop.q) - D) @ far
    return named


def loop_with(setting: Setting, X: Any, NX: Any) -> tuple[Any, Any]:
    """Return A X and G X of the linear loop eta~ = N e: e+ = A e, v = G e."""
    loop = setting.loop
    n = loop.n
    F, G = loop.F[:, :n] @ X, loop.G[:, :n] @ X
    return (F, G) if loop.q == 0 else (F + loop.F[:, n:] @ NX, G + loop.G[:, n:] @ NX)
