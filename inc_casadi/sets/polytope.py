"""The polytope {x: H x <= h} in R^n."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, columns, frozen, matrix, vector
from ..errors import DimensionError, EmptySetError, SolverError
from . import halfspaces, rules, simplex
from .base import Set


@dataclass(frozen=True, eq=False)
class Polytope(Set):
    """The polytope {x: H x <= h}: bounded, nonempty and full-dimensional, which is checked by linear programs.

    Vertices and triangulation are computed when first asked for, by Qhull; their number grows fast with n.

    Parameters
    ----------
    H : (k, n) outward normals of the half-spaces, of any length; a zero row with h >= 0 is dropped
    h : (k,)

    Raises
    ------
    DimensionError : the shapes do not fit
    EmptySetError : the polytope is empty, flat or unbounded
    InvalidInputError : a NaN or an infinity

    Examples
    --------
    >>> triangle = Polytope(H=[[-1, 0], [0, -1], [1, 1]], h=[0, 0, 1])
    >>> round(triangle.volume, 12), triangle.center.round(6).tolist()
    (0.5, [0.333333, 0.333333])
    """

    H: Array
    h: Array

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, H: ArrayLike, h: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        H = matrix("H", self.H)
        if 0 in H.shape:
            raise DimensionError(f"H has shape {H.shape}, but a polytope needs half-spaces and coordinates")
        h = vector("h", self.h, H.shape[0])
        kept = np.any(H != 0, axis=1)
        for i in np.flatnonzero(~kept & (h < 0)):
            raise EmptySetError(f"the polytope is empty: row {i} of H is zero and h[{i}] = {h[i]:g} is negative")
        if not np.any(kept):
            raise EmptySetError("the polytope is unbounded: every row of H is zero")
        object.__setattr__(self, "H", frozen(H[kept]))
        object.__setattr__(self, "h", frozen(h[kept]))
        self._frame  # noqa: B018  # looking at the frame is the check that the set is bounded and has an interior

    @classmethod
    def from_vertices(cls, vertices: ArrayLike) -> Polytope:
        """Return the convex hull of points given as columns (n, N); `.vertices` are those of them that are extreme.

        Raises
        ------
        DimensionError : not a matrix
        EmptySetError : the points lie in a hyperplane, so the hull is flat

        >>> Polytope.from_vertices([[0, 1, 0, 0.2], [0, 0, 1, 0.2]]).vertices.tolist()
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        """
        points = matrix("vertices", vertices)
        if 0 in points.shape:
            raise EmptySetError(f"vertices has shape {points.shape}: there is no point to span a polytope")
        H, h, extreme = _hull(points)
        polytope = cls(H, h)
        # Given vertices are kept to the last bit: recomputing them from H and h would only lose digits.
        polytope.__dict__["vertices"] = frozen(points[:, extreme])
        return polytope

    @property
    def dimension(self) -> int:
        """The dimension n."""
        return self.H.shape[1]

    @cached_property
    def vertices(self) -> Array:
        """The extreme points (n, N), each once, in no particular order."""
        if self.dimension == 1:
            ends = self.h / self.H[:, 0]
            return frozen(np.array([[ends[self.H[:, 0] < 0].max(), ends[self.H[:, 0] > 0].min()]]))
        return frozen(halfspaces.vertices(self._frame))

    @property
    def center(self) -> Array:
        """The centroid (n,)."""
        return self._moments[0]

    @property
    def covariance(self) -> Array:
        """The covariance (n, n) of the uniform distribution, from the closed form on each simplex."""
        return self._moments[1]

    @property
    def volume(self) -> float:
        """The sum of the volumes of the simplices."""
        return float(simplex.volumes(self.simplices()).sum())

    def contains(self, x: ArrayLike, tol: float = 0.0) -> bool | np.ndarray:
        """Return whether x is within distance `tol` of every half-space.

        Parameters
        ----------
        x : (n,) or columns (n, N)
        tol : allowance as a Euclidean distance, in the units of x

        >>> Polytope([[1], [-2]], [1, 2]).contains([[0.0, 1.1]]).tolist()
        [True, False]
        """
        points, single = columns("x", x, self.dimension)
        allowance = tol * np.linalg.norm(self.H, axis=1)
        inside = np.all(self.H @ points <= (self.h + allowance)[:, None], axis=0)
        return bool(inside[0]) if single else inside

    def support(self, direction: ArrayLike) -> float | Array:
        """Return the maximum of direction'x over the polytope, attained at a vertex, for (n,) or columns (n, N).

        >>> Polytope([[1], [-2]], [1, 2]).support([-3.0])
        3.0
        """
        directions, single = columns("direction", direction, self.dimension)
        values = np.max(self.vertices.T @ directions, axis=0)
        return float(values[0]) if single else values

    def simplices(self) -> Array:
        """Return a triangulation (N, n + 1, n) into simplices with positive volume and corners among the vertices.

        >>> Polytope([[1, 0], [-1, 0], [0, 1], [0, -1]], [1, 1, 1, 1]).simplices().shape
        (2, 3, 2)
        """
        return self._triangulation

    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent uniform points (n, N): a simplex by its volume, then a uniform point in it.

        >>> Polytope([[-1, 0], [0, -1], [1, 1]], [0, 0, 1]).sample(4, np.random.default_rng(0)).shape
        (2, 4)
        """
        return simplex.sample(self._triangulation, self._shares, rules.whole("N", N, 0), rng)

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return a conical product rule on every simplex, exact for polynomials of degree 2 order - 1.

        >>> nodes, weights = Polytope([[-1, 0], [0, -1], [1, 1]], [0, 0, 1]).quadrature(2)
        >>> round(1 / float(weights @ nodes[0] ** 3), 9)
        10.0
        """
        return simplex.quadrature(self._triangulation, self._shares, order)

    @cached_property
    def _frame(self) -> halfspaces.Frame:
        return halfspaces.frame(self.H, self.h)

    @cached_property
    def _triangulation(self) -> Array:
        return frozen(simplex.delaunay(self.vertices, self._frame.origin, self._frame.widths))

    @cached_property
    def _shares(self) -> Array:
        volumes = simplex.volumes(self._triangulation / self._frame.widths)
        return frozen(volumes / volumes.sum())

    @cached_property
    def _moments(self) -> tuple[Array, Array]:
        mean, covariance = simplex.moments(self._triangulation, self._shares)
        return frozen(mean), frozen(covariance)


def _hull(points: Array) -> tuple[Array, Array, np.ndarray]:
    # Half-spaces and the indices of the extreme points; Qhull works in coordinates of size one.
    low, high = points.min(axis=1), points.max(axis=1)
    origin, widths = (low + high) / 2, (high - low) / 2
    for i in np.flatnonzero(widths <= 0):
        raise EmptySetError(f"the polytope is flat: every given vertex has coordinate {i} equal to {low[i]:g}")
    if points.shape[0] == 1:
        return np.array([[1.0], [-1.0]]), np.array([high[0], -low[0]]), np.array([points.argmin(), points.argmax()])
    scaled = ((points - origin[:, None]) / widths[:, None]).T
    spread = np.linalg.svd(scaled - scaled.mean(axis=0), compute_uv=False)
    if len(spread) < len(points) or spread[-1] <= halfspaces.FLAT_TOL:
        raise EmptySetError(f"the polytope is flat: the {points.shape[1]} given vertices lie in a hyperplane of "
                            f"R^{points.shape[0]}")
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(scaled)
    except QhullError as error:
        raise SolverError(f"Qhull did not find the convex hull of {points.shape[1]} points") from error
    G, g = _distinct(hull.equations)
    H = G / widths
    return H, g + H @ origin, np.sort(hull.vertices)


def _distinct(equations: Array) -> tuple[Array, Array]:
    # Qhull lists a facet once for each simplex it is cut into: merge rows (normal, -offset) that agree to rounding.
    keep = halfspaces.distinct(equations)
    return equations[keep, :-1], -equations[keep, -1]
