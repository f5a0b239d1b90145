"""Maximal output-admissible sets: where a linear motion keeps its constraints for ever (E. G. Gilbert, K. T. Tan, 1991)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, matrix, vector
from .blocks import exact
from .brief import Brief
from .certificate import Proof
from .errors import ConvergenceError, DimensionError, EmptySetError, InvalidInputError
from .implied import unproved
from .inc import INC
from .linear_program import irredundant, maximum
from .loop import close_loop, equilibrium
from .pieces.laws import Laws, PiecewiseLoop
from .pieces.linear import identity, solve
from .plant import Plant, as_plant
from .sets import Box, Polytope

ROOM = 1e-9  # by this share the set is contractive, and by this share it is shrunk: what the exact proof needs
DOUBT = 1e-10  # a row within this share of its bound is in doubt
LIMIT = 1e-3  # how far inside its bounds a motion that does not die out must end
MOST_STEPS = 2_000


@dataclass(frozen=True, eq=False)
class AdmissibleSet(Brief):
    """A polytope that the map x+ = A x + c maps into itself, and on which H x <= h.

    polytope: the set; steps: the k from which on H A^k x <= h follows from the earlier ones; A (n, n), c (n,), H (k, n), h
    (k,): the map and the constraints, floats or Fractions.

    By induction every motion from the set keeps H x <= h for ever. That it is so is `prove`d, not believed.
    """

    polytope: Polytope
    steps: int
    A: Array
    c: Array
    H: Array
    h: Array

    def prove(self) -> Proof:
        """Settle in Fractions that G x <= g implies H x <= h and G (A x + c) <= g, by Farkas' multipliers (`implied`)."""
        start = time.perf_counter()
        G, g = exact(self.polytope.H), exact(self.polytope.h)
        reason, row = "", unproved(G, g, self.H, self.h)
        if row is not None:
            reason = f"constraint {row} is not proved to hold on the set"
        else:
            row = unproved(G, g, G @ exact(self.A), g - G @ exact(self.c))
            if row is not None:
                reason = f"half-space {row} of the set is not proved to hold one step on"
        return Proof(not reason, "Farkas multipliers in fractions", time.perf_counter() - start, reason)


def is_invariant(polytope: Polytope, A: ArrayLike, c: ArrayLike | None = None) -> bool:
    """Return whether A x + c is in the polytope for every x in it, proved in Fractions by Farkas' multipliers; sufficient.

    A: (n, n) and c: (n,), zero when left out; floats or Fractions. False means undecided, as in `implied.is_implied`.

    >>> box = Polytope([[1.0], [-1.0]], [1.0, 1.0])
    >>> is_invariant(box, [[-0.9]]), is_invariant(box, [[1.1]]), is_invariant(box, [[0.5]], [0.6])
    (True, False, False)
    """
    G, g = exact(polytope.H), exact(polytope.h)
    shift = exact(np.zeros(polytope.dimension) if c is None else np.asarray(c))
    return unproved(G, g, G @ exact(np.asarray(A)), g - G @ shift) is None


def maximal_admissible_set(A: ArrayLike, H: ArrayLike, h: ArrayLike) -> AdmissibleSet:
    """Return {x: H A^k x <= h for all k >= 0}, up to about 1e-9 of its size within it.

    The rows H A^k are added until the next ones follow from those there are, which a linear program tells; then all later
    ones follow. A row in doubt is kept. So that rounding cannot spoil invariance, the rows are those of A / (1 - 1e-9),
    whose set A maps into (1 - 1e-9) times itself, and in the end the set is shrunk by 1e-9: it is a subset of the
    maximal one, and `prove` shows that it is admissible and invariant.

    Where A has the eigenvalue 1 (semisimple, the other ones within the unit circle), motions end in points P x, P = lim A^k,
    and the set may have infinitely many facets: H P x <= (1 - 1e-3) h is demanded, which leaves finitely many.
    There rounding may leave `prove` undecided.

    A: (n, n); H: (k, n); h: (k,), positive: the origin satisfies the constraints strictly.

    Raises InvalidInputError when h is not positive or A is not stable, EmptySetError when the set is not bounded,
    ConvergenceError when 2000 steps do not determine it.

    >>> found = maximal_admissible_set([[0.5, 1.0], [0.0, 0.5]], [[1.0, 0.0], [-1.0, 0.0]], [1.0, 1.0])
    >>> found.steps, round(found.polytope.volume, 6), bool(found.prove())
    (2, 3.75, True)
    """
    A = matrix("A", A)
    if A.shape[0] != A.shape[1]:
        raise DimensionError(f"A has shape {A.shape}, but must be square")
    H = matrix("H", H, (None, A.shape[0]))
    h = vector("h", h, H.shape[0])
    G, g, steps = _determined(A, H, h)
    return AdmissibleSet(Polytope(G, g), steps, A, np.zeros(len(A)), H, h)


def admissible_set(plant: Plant, law: INC | ArrayLike, inputs: Box | Polytope | None,
                   states: Box | Polytope | None = None) -> AdmissibleSet:
    """Return the set around the loop's equilibrium from which inputs and states keep their limits for ever.

    For an INC it is the set where, besides, every hidden unit stays on the piece it is on at the equilibrium: there the
    controller is one affine law for ever, and the motion converges to the equilibrium. Map and limits are formed in
    Fractions.

    plant: in discrete time; law: an INC of its measurement, or the gain K (m, p) of u = K y; inputs, states: limits.

    Raises what `maximal_admissible_set` raises; EmptySetError when the equilibrium lies on a kink or limit.

    >>> found = admissible_set(Plant([[1.2]], [[1.0]]), INC.saturated([[-0.8]], 1.0), Box([-1.0], [1.0]))
    >>> found.polytope.vertices.round(6).tolist()
    [[-1.25, 1.25]]
    """
    plant = as_plant(plant)
    inc = (law if isinstance(law, INC) else INC.linear(law)).without_idle_units()  # type: ignore[arg-type]
    close_loop(plant, inc)
    loop = PiecewiseLoop(plant, inc, "exact")
    here = loop.laws(loop.patterns_at(exact(equilibrium(plant, inc).x)[None]))
    A = exact(plant.A) + exact(plant.B) @ here.Gx[0]
    c = exact(plant.B) @ here.g[0]
    rest = solve(identity(plant.n, A) - A, c[:, None])[:, 0]
    parts = _limits(plant, here, inputs, states)
    for rows, bounds, name in parts:
        if np.any(bounds - rows @ rest <= 0):
            raise EmptySetError(f"the equilibrium x* = {np.round(rest.astype(float), 6).tolist()} lies on or beyond {name}")
    H, h = np.concatenate([rows for rows, _, _ in parts]), np.concatenate([bounds for _, bounds, _ in parts])
    moving = np.array([bool(row.any()) for row in H], dtype=bool)
    H, h = H[moving], h[moving]
    G, g, steps = _determined(A.astype(float), H.astype(float), (h - H @ rest).astype(float))
    return AdmissibleSet(Polytope(G, g + G @ rest.astype(float)), steps, A, c, H, h)


def _limits(plant: Plant, here: Laws, inputs: Box | Polytope | None,
            states: Box | Polytope | None) -> list[tuple[Array, Array, str]]:
    """Rows, bounds and name of what limits the state while the law is `here`'s first one, in Fractions."""
    low, high = (np.isfinite(part[0].astype(float)) for part in (here.low, here.high))
    parts = [(here.Zx[0][high], here.high[0][high] - here.z0[0][high], "a kink"),
             (-here.Zx[0][low], here.z0[0][low] - here.low[0][low], "a kink")]
    for name, limits, size in (("inputs", inputs, plant.m), ("states", states, plant.n)):
        if limits is not None and limits.dimension != size:
            raise DimensionError(f"{name} is a set in R^{limits.dimension}, but the plant has {size}")
    if inputs is not None:
        limits_of_u = exact(inputs.H)
        parts.append((limits_of_u @ here.Gx[0], exact(inputs.h) - limits_of_u @ here.g[0], "an input limit"))
    if states is not None:
        parts.append((exact(states.H), exact(states.h), "a state limit"))
    return parts


def _determined(A: Array, H: Array, h: Array) -> tuple[Array, Array, int]:
    """Rows G x <= g of the shrunk set of A / (1 - ROOM), and the number of steps that determined them."""
    for i in np.flatnonzero(h <= 0):
        raise InvalidInputError(f"h[{i}] = {h[i]:g}, but the origin must satisfy the constraints strictly: h > 0")
    rows = H / h[:, None]
    across = np.abs(rows).max(axis=0, initial=0.0)
    width = 1.0 / np.where(across > 0, across, 1.0)
    step, limit = _inflated(A)
    # Columns of size one, since the tolerances of linear programs are absolute.
    step, rows = step * width / width[:, None], rows * width
    G, g = rows, np.ones(len(rows))
    if limit is not None:
        G, g = np.vstack([G, rows @ (limit * width / width[:, None])]), np.append(g, np.full(len(rows), 1 - LIMIT))
        G, g = G[np.any(G != 0, axis=1)], g[np.any(G != 0, axis=1)]
    for steps in range(MOST_STEPS):
        rows = rows @ step
        news = np.array([_exceeds(row, G, g) for row in rows])
        if not news.any():
            keep = irredundant(G, g, DOUBT)
            return G[keep] / width, g[keep] * (1 - ROOM), steps
        G, g = np.vstack([G, rows[news]]), np.append(g, np.ones(int(news.sum())))
    raise ConvergenceError(f"{MOST_STEPS} steps do not determine the admissible set: the spectral radius of A is "
                           f"{np.max(np.abs(np.linalg.eigvals(A))):.9g}")


def _exceeds(row: Array, G: Array, g: Array) -> bool:
    best = maximum(row, G, g)
    return best is None or best.value > 1 - DOUBT


def _inflated(A: Array) -> tuple[Array, Array | None]:
    """The map with its decaying part enlarged by ROOM, and lim A^k where that is not zero."""
    modes = np.linalg.eigvals(A)
    radius = float(np.max(np.abs(modes)))
    if radius < 1 - 2 * ROOM:
        return A / (1 - ROOM), None
    ones = np.abs(modes - 1) < 1e-9
    if np.all(np.abs(modes[~ones]) < 1 - 2 * ROOM):
        right, left = _kernel(A - np.eye(len(A))), _kernel(A.T - np.eye(len(A)))
        if right.shape[1] == int(ones.sum()):
            limit = right @ np.linalg.solve(left.T @ right, left.T)
            return limit + (A - limit) / (1 - ROOM), limit
    raise InvalidInputError(f"A is not stable: its spectral radius is {radius:.9g}, and the maximal set is computed where "
                            "it is below 1, or where 1 is the only eigenvalue on the unit circle and semisimple")


def _kernel(M: Array) -> Array:
    _, sizes, right = np.linalg.svd(M)
    return right[sizes <= 1e-9 * max(float(sizes[0]), 1.0)].T
