"""The ellipsoid of lowest cost that contains given states, under given bounds on the hidden units: one convex program."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .affine import Affine, index_of
from .arrays import Array
from .lmi_local_goal import corner, diagonal
from .lmi_local_program import Around, Form, Program, limit_rows
from .lmi_problem import Block, Problem
from .local.base import Setting, input_rows, without_cost
from .local.containment import Hull
from .multipliers.base import Unknown
from .sets import Ellipsoid

INSIDE = 1e-6  # share of the forms at the initial states that is left free


def program_for_cost(setting: Setting, around: Around, P: Array, asked: Hull) -> Program:
    """Return the program of the least gamma with V decreasing, V <= 1 at the deviations asked for, and gamma V a cost bound.

    gamma (V - discount V+) - e'Qe - v'Rv >= 0 on the graph, so gamma bounds the cost from every point of the ellipsoid.
    In X = P^-1 (`lmi_local_program.program_for`) and with multipliers of its own for the cost, Schur's complement makes it
    linear in X, S, Y and gamma. That P_cost is gamma P here only serves to find P and the bending rows.

    P: (n, n) about right: coordinates are chosen in which X is near the identity; asked: deviations (n, k) from rest, or
    the ellipsoid of all initial states.
    """
    n, q = setting.loop.n, setting.loop.q
    plain, root = without_cost(setting), np.linalg.cholesky(np.linalg.inv(P))
    fixed = np.ones((q, n), dtype=bool)
    fixed[np.flatnonzero(around.bend)] = False
    places, size = index_of([Unknown("X", (n, n), "symmetric"), Unknown("S", (q,), "nonnegative"),
                             Unknown("S_cost", (q,), "nonnegative"), Unknown("Y", (q, n), "free", zero=fixed),
                             Unknown("gamma", (1,), "nonnegative"),
                             Unknown("t", (int(isinstance(asked, Ellipsoid)),), "nonnegative")])
    X, Y = Affine.unknown(places["X"]), Affine.unknown(places["Y"])
    form, costs = (Form(plain, around, root, X, diagonal(places[name]), Y) for name in ("S", "S_cost"))
    blocks = (form.falls(), _pays(setting, costs, int(places["gamma"][0])), *form.inputs(), *form.rooms(),
              *_contains(X, root, asked, setting.rest.center, places["t"]))
    rows, offset = limit_rows(plain, around, root, X, size)
    cost, lower = np.zeros(size), np.full(size, -np.inf)
    cost[places["gamma"]] = 1.0
    lower[places["S"]] = lower[places["S_cost"]] = lower[places["t"]] = 0.0
    limits = np.array([float(room) for room in input_rows(setting)[1]])
    return Program(Problem(cost, blocks, rows, offset, lower, np.full(size, np.inf)), places, root, limits)


def _pays(setting: Setting, form: Form, gamma: int) -> Block:
    """Return gamma (V - discount V+) - e'Qe - v'Rv >= 0 on the graph, over (e^, psi^), e+ and the weighed (e, v)."""
    claim, (_, step, G) = setting.claim, form.maps
    assert claim.Q is not None and claim.R is not None
    n, q = form.X.shape[0], form.S.shape[0]
    state = np.hstack([_half(claim.Q) @ form.root, np.zeros((n, q))])
    stage = np.vstack([state, _half(claim.R) @ G])
    stage = stage / (np.linalg.norm(state) or 1.0)  # so that gamma is near 1
    k = len(stage)
    size = 2 * n + q + k
    (ahead_e, ahead_psi), (stage_e, stage_psi) = form.image(step), form.image(stage)
    found = (form.base(size, 1.0) + corner(2.0 * ahead_e, size, n + q, 0) + corner(2.0 * ahead_psi, size, n + q, n)
             + corner((1.0 / claim.discount) * form.X, size, n + q, n + q)
             + corner(2.0 * stage_e, size, 2 * n + q, 0) + corner(2.0 * stage_psi, size, 2 * n + q, n)
             + corner(diagonal(np.full(k, gamma)), size, 2 * n + q, 2 * n + q))
    return found.block(np.eye(size))


def _contains(X: Affine, root: Array, asked: Hull, center: Array, t: NDArray[np.intp]) -> list[Block]:
    """Return the blocks that say that {f'X^-1 f <= 1} contains what is asked for, with room for rounding.

    Deviations f: [1, f'; f, X] >= 0. An ellipsoid {a + A d: |d| <= 1}: [1 - t, 0, a'; 0, t I, A'; a, A, X] >= 0 for some t.
    """
    n, grown_by = X.shape[0], 1 + INSIDE
    if not isinstance(asked, Ellipsoid):
        return [(corner(X, n + 1, 1, 1) + _edged(f[:, None])).block(np.eye(n + 1))
                for f in np.linalg.solve(root, asked).T * grown_by]
    A = np.sqrt(asked.level) * np.linalg.inv(np.linalg.cholesky(asked.P).T)
    sides = np.linalg.solve(root, np.hstack([(asked.center - center)[:, None], A])) * grown_by
    share = Affine.unknown(t[:, None])
    whole = corner(X, 2 * n + 1, n + 1, n + 1) + _edged(sides) + corner(-share, 2 * n + 1, 0, 0)
    return [(whole + corner(diagonal(np.full(n, t[0])), 2 * n + 1, 1, 1)).block(np.eye(2 * n + 1))]


def _edged(sides: Array) -> Array:
    """Return zeros but for a 1 in the upper left corner and sides (n, k) in the lower left one, and its transpose."""
    n, k = sides.shape
    found = np.zeros((n + k, n + k))
    found[0, 0] = 1.0
    found[k:, :k], found[:k, k:] = sides, sides.T
    return found


def _half(M: Array) -> Array:
    """Return a square root of a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(M)
    return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
