"""Half-spaces {x: H x <= h}: bounded or not, flat or not, a frame in which they are of size one, and their vertices.

Linear programs have absolute tolerances, so a polytope of size 1e-6 or 1e6, or one far from the origin, is first moved
into a frame z = (x - origin) / widths in which its bounding box is about [-1, 1]^n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import EmptySetError, SolverError

LP_TOL = 1e-10  # feasibility tolerance asked of HiGHS, in the frame
FLAT_TOL = 1e-8  # an inscribed ball below this radius, in the frame, is no interior
MERGE_TOL = 1e-9  # vertices closer than this, in the frame, are one vertex
ROUNDING = 1e-14  # an inner slack below this fraction of the numbers it is the difference of is rounding, not interior
FILL_TOL = 1e-7  # how far, in the frame, a facet of the hull of the vertices may lie from its half-space
PASSES = 8  # each pass shrinks the frame by up to 1e9: enough for every polytope that doubles can describe


@dataclass(frozen=True, eq=False)
class Frame:
    """Half-spaces G z <= g with unit rows, z = (x - origin) / widths, and the centre of the largest ball inside."""

    G: Array
    g: Array
    origin: Array
    widths: Array
    inner: Array


def frame(H: Array, h: Array) -> Frame:
    """Return the frame of {x: H x <= h}; H (k, n) has no zero row.

    Raises
    ------
    EmptySetError : there is no point, no interior, or no bound
    SolverError : HiGHS ends without an answer

    >>> frame(np.array([[2.0], [-2.0]]), np.array([2e-6, 0.0])).widths.round(12).tolist()
    [5e-07]
    """
    row_scale, widths = _equilibrated(H)
    H, h = H / row_scale[:, None], h / row_scale
    widths = widths * (float(np.max(np.abs(h))) or 1.0)
    G, g = _scaled(H, h, np.zeros(H.shape[1]), widths)
    if _maximum(np.zeros(H.shape[1]), G, g) is None:
        raise EmptySetError("the polytope is empty: no x satisfies H x <= h")
    _refuse_unbounded(G)
    origin, widths = _settled(H, h, widths)
    G, g = _scaled(H, h, origin, widths)
    inner, radius = _chebyshev(G, g)
    if radius < FLAT_TOL or _slack_is_rounding(H, h, origin + widths * inner):
        raise EmptySetError(_flat())
    return Frame(G, g, origin, widths, inner)


def vertices(view: Frame) -> Array:
    """Return the vertices (n, N) of the polytope of a frame, each once.

    Qhull finds them, a Newton step makes them exact to rounding, and their hull is checked to be the whole polytope.

    Raises
    ------
    SolverError : Qhull fails, or what it finds is not the whole polytope

    >>> view = frame(np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]), np.array([1.0, 1.0, 0.0]))
    >>> sorted(vertices(view).T.round(9).tolist())
    [[-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]
    """
    from scipy.spatial import HalfspaceIntersection, QhullError

    halfspaces = np.column_stack([view.G, -view.g])
    # When many half-spaces meet in a vertex, rounding can confuse Qhull: Q12 then lets it go on, and the check decides.
    for options in (None, "Qx Q12" if view.G.shape[1] > 4 else "Q12"):
        try:
            z = HalfspaceIntersection(halfspaces, view.inner, qhull_options=options).intersections
        except QhullError:
            continue
        if np.all(np.isfinite(z)):
            z = _polished(view, z)
            z = z[distinct(z)]
            if _fills(view, z):
                return view.origin[:, None] + view.widths[:, None] * z.T
    count, n = view.G.shape
    raise SolverError(f"Qhull did not find the vertices of a polytope of {count} half-spaces in R^{n}: leave out "
                      "redundant half-spaces, or use Polytope.from_vertices")


def distinct(points: Array) -> np.ndarray:
    """Return a mask (N,) that keeps one of all rows (N, n) closer than the merging tolerance.

    >>> distinct(np.array([[0.0], [1.0], [1e-12]])).tolist()
    [True, True, False]
    """
    from scipy.spatial import cKDTree

    keep = np.ones(len(points), dtype=bool)
    keep[cKDTree(points).query_pairs(MERGE_TOL, output_type="ndarray")[:, 1]] = False
    return keep


def _polished(view: Frame, z: Array) -> Array:
    # One Newton step onto the half-spaces that meet in each vertex, by least squares when they are more than n.
    slack = view.g - z @ view.G.T
    slack_of_active = np.where(np.abs(slack) <= MERGE_TOL, slack, 0.0)
    active = (np.abs(slack) <= MERGE_TOL).astype(float)
    normal = np.einsum("vk,ki,kj->vij", active, view.G, view.G)
    return z + (np.linalg.pinv(normal, hermitian=True) @ (slack_of_active @ view.G)[:, :, None])[:, :, 0]


def _fills(view: Frame, z: Array) -> bool:
    # The hull of points of the polytope is all of it when each facet of the hull lies on one of the half-spaces.
    from scipy.spatial import ConvexHull, QhullError

    slack = view.g - z @ view.G.T
    try:
        facets = ConvexHull(z).simplices
    except QhullError:
        return False
    on_one = np.any(np.all((np.abs(slack) <= FILL_TOL)[facets], axis=1), axis=1)
    return bool(np.all(slack >= -FILL_TOL) and np.all(on_one))


def _equilibrated(H: Array) -> tuple[Array, Array]:
    # Alternate row and column scaling (Ruiz, 2001), so that coordinates of different units count alike.
    rows, cols = np.ones(H.shape[0]), np.ones(H.shape[1])
    for _ in range(5):
        size = np.abs(H) / rows[:, None] * cols
        across = size.max(axis=0)
        if np.any(across == 0):
            free = int(np.flatnonzero(across == 0)[0])
            raise EmptySetError(f"the polytope is unbounded: no row of H holds coordinate {free}")
        rows, cols = rows * np.sqrt(size.max(axis=1)), cols / np.sqrt(across)
    return rows, cols


def _scaled(H: Array, h: Array, origin: Array, widths: Array) -> tuple[Array, Array]:
    G = H * widths
    norms = np.linalg.norm(G, axis=1)
    return G / norms[:, None], (h - H @ origin) / norms


def _refuse_unbounded(G: Array) -> None:
    # A cone {d: G d <= 0} that is more than {0} reaches the boundary of the cube, so each maximum is 0 or 1.
    n = G.shape[1]
    for i, direction in enumerate(np.vstack([np.eye(n), -np.eye(n)])):
        reach = _maximum(direction, G, np.zeros(len(G)), bound=1.0)
        if reach is None or direction @ reach > 0.5:
            sense = "above" if i < n else "below"
            raise EmptySetError(f"the polytope is unbounded: nothing limits coordinate {i % n} from {sense}")


def _settled(H: Array, h: Array, widths: Array) -> tuple[Array, Array]:
    n = H.shape[1]
    origin = np.zeros(n)
    directions = np.vstack([np.eye(n), -np.eye(n)])
    for _ in range(PASSES):
        G, g = _scaled(H, h, origin, widths)
        ends = [_maximum(direction, G, g) for direction in directions]
        if any(end is None for end in ends):
            raise EmptySetError(_flat())
        high, low = np.array([end[i % n] for i, end in enumerate(ends)]).reshape(2, n)  # type: ignore[index]
        half = (high - low) / 2
        origin = origin + widths * (high + low) / 2
        widths = widths * np.maximum(half, 1e-9)
        if np.all((half > 0.1) & (half < 10)):
            return origin, widths
    raise EmptySetError(_flat())


def _chebyshev(G: Array, g: Array) -> tuple[Array, float]:
    n = G.shape[1]
    solution = _maximum(np.eye(n + 1)[n], np.column_stack([G, np.ones(len(g))]), g)
    if solution is None:
        raise EmptySetError(_flat())
    return solution[:n], float(solution[n])


def _slack_is_rounding(H: Array, h: Array, x: Array) -> bool:
    return bool(np.any(h - H @ x <= ROUNDING * (np.abs(H) @ np.abs(x) + np.abs(h))))


def _maximum(direction: Array, G: Array, g: Array, bound: float | None = None) -> Array | None:
    # The maximizer of direction'z over G z <= g, |z| <= bound; None when there is no feasible point.
    from scipy.optimize import linprog

    limits = (None, None) if bound is None else (-bound, bound)
    options = {"primal_feasibility_tolerance": LP_TOL, "dual_feasibility_tolerance": LP_TOL}
    outcome = linprog(-direction, A_ub=G, b_ub=g, bounds=limits, method="highs", options=options)
    if outcome.status == 2:
        return None
    if outcome.status == 3:
        raise EmptySetError("the polytope is unbounded")
    if outcome.status != 0:
        raise SolverError(f"a linear program over the polytope was not solved: {outcome.message}")
    return np.asarray(outcome.x)


def _flat() -> str:
    return ("the polytope has no interior to rounding: its half-spaces leave at most a flat set; a set must be "
            "full-dimensional, so describe it in fewer coordinates or widen it")
