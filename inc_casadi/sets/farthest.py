"""Where a distribution reaches farthest: the points by which constraints for all initial states are judged."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .base import Distribution
from .box import Box
from .ellipsoid import Ellipsoid


def farthest(initial: Distribution, directions: Array) -> Array:
    """Return points (n, c) of the hull of the distribution that go farthest in the given directions (n, c).

    >>> from inc_casadi import Box, Uniform
    >>> farthest(Uniform(Box([0, 0], [1, 2])), np.array([[1.0], [-1.0]])).ravel().tolist()
    [1.0, 0.0]
    """
    support = initial.support
    if isinstance(support, Ellipsoid):
        steps = np.linalg.solve(support.P, directions)
        sizes = np.sqrt(np.maximum(np.sum(directions * steps, axis=0), np.finfo(float).tiny))
        return support.center[:, None] + np.sqrt(support.level) * steps / sizes
    if isinstance(support, Box):
        return np.where(directions > 0, support.upper[:, None], support.lower[:, None])
    return initial.vertices[:, np.argmax(initial.vertices.T @ directions, axis=0)]
