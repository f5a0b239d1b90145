"""The largest ellipsoid under given bounds on the hidden units: one convex program in X = P^-1, as data for a solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .affine import Affine, index_of
from .arrays import Array
from .lmi_local_goal import Places, corner, diagonal, goal, goal_unknowns
from .lmi_problem import Block, Problem
from .local.base import Setting, input_rows, state_rows
from .local.lines import Lines
from .multipliers.base import Unknown


@dataclass(frozen=True, eq=False)
class Around:
    """What is known of the hidden units in floats: two lines each, and rows with |g_i e| <= room_i that prove their bounds.

    near, far, bend, bent_room: (q,), see `local.lines.Lines`; g: (k, n) already divided by the rooms.
    """

    near: Array
    far: Array
    bend: Array
    bent_room: Array
    g: Array

    @classmethod
    def of(cls, found: Lines, g: Array, rooms: Array, bounded: np.ndarray) -> Around:
        """Return it from lines in Fractions, g (q, n) and rooms (q,) of the bounded units."""
        near, far, bend, room = (np.array(part, dtype=float) for part in (found.near, found.far, found.bend, found.room))
        return cls(near, far, bend, room, g[bounded] / rooms[bounded, None])


@dataclass(frozen=True, eq=False)
class Program:
    """A problem with what its unknowns stand for: X = root X^ root', S, Y and the rest. places: by name."""

    problem: Problem
    places: Places
    root: Array
    limits: Array

    def values_at(self, y: Array) -> dict[str, Array]:
        """Return P, H, Lambda and Lambda_inputs at a solver's point."""
        X = self.root @ y[self.places["X"]] @ self.root.T
        P = np.linalg.inv(X)
        P = (P + P.T) / 2
        Y = np.where(self.places["Y"] >= 0, y[self.places["Y"]], 0.0)
        weights = 1.0 / y[self.places["S"]]
        found = {"P": P, "H": Y @ self.root.T @ P, "Lambda": weights}
        return found | ({"Lambda_inputs": np.outer(self.limits**2, weights)} if self.limits.size else {})


def program_for(setting: Setting, around: Around, P: Array) -> Program:
    """Return the program of the largest ellipsoid {e'X^-1 e <= 1} in the shape that the claim asks for.

    With psi = near z~ - eta~ (I - W near is nonsingular, since near lies between the units' slopes and W is well posed) a
    form e'P e - |e+|^2_P / rate^2 - 2 psi'Lambda ((near - far) z~ - bend H e - psi) is, after e = X e^ and psi = S psi^, S =
    Lambda^-1, and Schur's complement, linear in X, S and Y = H X. So are |g e| <= 1: g X g' <= 1, the limits, and the shape
    that is maximized (`lmi_local_goal`).

    P: (n, n) about right: coordinates are chosen in which X is near the identity.

    >>> from inc_casadi import INC, Plant, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.interior_point import solve
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.5]], [[1.0]]), INC.saturated([[-1.0]], 1.0))
    >>> around = Around(*np.array([[1.0], [0.0], [1.0], [1.0]]), g=np.zeros((0, 1)))   # sat between z and h, |h| <= 1
    >>> program = program_for(Setting(loop, Attraction(), rest_of(loop)), around, np.eye(1))
    >>> round(float(program.values_at(solve(program.problem).y)["P"].item()), 6)           # all of |x| < 2 can be steered
    0.25
    """
    n, q = setting.loop.n, setting.loop.q
    root = np.linalg.cholesky(np.linalg.inv(P))
    fixed = np.ones((q, n), dtype=bool)
    fixed[np.flatnonzero(around.bend)] = False
    unknowns = [Unknown("X", (n, n), "symmetric"), Unknown("S", (q,), "nonnegative"),
                Unknown("Y", (q, n), "free", zero=fixed), *goal_unknowns(setting.claim, n)]
    places, size = index_of(unknowns)
    form = Form(setting, around, root, Affine.unknown(places["X"]), diagonal(places["S"]), Affine.unknown(places["Y"]))
    shape, cost = goal(setting.claim, root, places, size)
    blocks = (form.falls(), *form.inputs(), *form.rooms(), *shape)
    rows, offset = limit_rows(setting, around, root, form.X, size)
    lower = np.full(size, -np.inf)
    lower[places["S"]] = 0.0
    limits = np.array([float(room) for room in input_rows(setting)[1]])
    return Program(Problem(cost, blocks, rows, offset, lower, np.full(size, np.inf)), places, root, limits)


@dataclass(frozen=True, eq=False)
class Form:
    """The forms over (e^, psi^) in the coordinates of `root`: e = root f, X = root X^ root', Y = Y^ root'."""

    setting: Setting
    around: Around
    root: Array
    X: Affine
    S: Affine
    Y: Affine

    @property
    def maps(self) -> tuple[Array, Array, Array]:
        """Return z~, e+ (in the coordinates of root) and v over (f, psi)."""
        loop, near = self.setting.loop, np.diag(self.around.near)
        n, q = loop.n, loop.q
        inner = np.linalg.inv(np.eye(q) - loop.Z[:, n:] @ near)
        Z = inner @ np.hstack([loop.Z[:, :n] @ self.root, -loop.Z[:, n:]])
        s = np.vstack([np.hstack([self.root, np.zeros((n, q))]), near @ Z - np.eye(q, n + q, n)])
        return Z, np.linalg.solve(self.root, loop.F @ s), loop.G @ s

    def base(self, size: int, share: float) -> Affine:
        """Return share X - He(psi' sector) in the upper left corner; `Affine.block` takes the symmetric part."""
        n, wide = self.X.shape[0], np.diag(self.around.near - self.around.far)
        Z = self.maps[0]
        across = wide @ Z[:, :n] @ self.X - np.diag(self.around.bend) @ self.Y
        own = wide @ Z[:, n:] @ self.S - self.S
        return share * corner(self.X, size, 0, 0) + corner(-2.0 * across, size, n, 0) + corner(-2.0 * own, size, n, n)

    def image(self, row: Array) -> tuple[Affine, Affine]:
        """Return rows over (f, psi) as rows over (e^, psi^), in two parts."""
        n = self.X.shape[0]
        return row[:, :n] @ self.X, row[:, n:] @ self.S

    def falls(self) -> Block:
        """Return the decrease of V."""
        n, q = self.X.shape[0], self.S.shape[0]
        rate, step = self.setting.claim.rate, self.maps[1]
        on_e, on_psi = self.image(step)
        if not self.setting.loop.plant.discrete:
            size = n + q
            flow = corner(-2.0 * on_e, size, 0, 0) + corner(-2.0 * on_psi, size, 0, n)
            return (self.base(size, -(rate or 0.0)) + flow).block(np.eye(size))
        size = 2 * n + q
        ahead = corner(2.0 * on_e, size, n + q, 0) + corner(2.0 * on_psi, size, n + q, n)
        whole = self.base(size, 1.0 if rate is None else rate**2) + ahead + corner(self.X, size, n + q, n + q)
        return whole.block(np.eye(size))

    def inputs(self) -> list[Block]:
        """Return one block for each input limit, with the multiplier room^2 Lambda."""
        n, q = self.X.shape[0], self.S.shape[0]
        size, found = n + q + 1, []
        H, rooms = input_rows(self.setting)
        one = np.zeros((size, size))
        one[-1, -1] = 1.0
        for row, room in zip(H, rooms, strict=True):
            on_e, on_psi = self.image((row @ self.maps[2])[None, :] / float(room))
            edge = corner(2.0 * on_e, size, n + q, 0) + corner(2.0 * on_psi, size, n + q, n)
            found.append((self.base(size, 1.0) + edge + one).block(np.eye(size)))
        return found

    def rooms(self) -> list[Block]:
        """Return |H_i e| <= room_i for the bent units."""
        n, found = self.X.shape[0], []
        one = np.zeros((n + 1, n + 1))
        one[0, 0] = 1.0
        for i in np.flatnonzero(self.around.bend):
            pick = np.eye(self.S.shape[0])[i: i + 1] / self.around.bent_room[i]
            edge = corner(2.0 * (pick @ self.Y), n + 1, 0, 1)
            found.append((corner(self.X, n + 1, 1, 1) + edge + one).block(np.eye(n + 1)))
        return found


def limit_rows(setting: Setting, around: Around, root: Array, X: Affine, size: int) -> tuple[Array, Array]:
    """Return 1 - g X g' >= 0 for the bounded units and the state limits."""
    H, rooms = state_rows(setting)
    states = H / np.array([float(room) for room in rooms]).reshape(-1, 1)
    g = np.vstack([around.g, states]) @ root
    coefficients, _ = X.rows(size)
    return -np.einsum("ia,ib->iab", g, g).reshape(len(g), len(coefficients)) @ coefficients, np.ones(len(g))
