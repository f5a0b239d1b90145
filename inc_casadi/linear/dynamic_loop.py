"""The loop of a plant and a linear dynamic controller, written as a larger plant under a static linear law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, frozen
from ..loop import fitting
from ..plant import Plant
from ..sets import Distribution
from ..sets.base import Set
from .controller import LinearController


@dataclass(frozen=True, eq=False)
class StartedFrom(Distribution):
    """The distribution of (x_0, xi_0) where xi_0 is fixed: flat, with moments as exact as those of x_0.

    Parameters
    ----------
    initial : the distribution of x_0, in R^n
    xi_0 : (l,) l >= 1

    Examples
    --------
    >>> from inc_casadi import Box, Uniform
    >>> pair = StartedFrom(Uniform(Box(-1, 1)), np.array([2.0]))
    >>> pair.second_moment.round(6).tolist(), pair.vertices.tolist()
    ([[0.333333, 0.0], [0.0, 4.0]], [[-1.0, 1.0], [2.0, 2.0]])
    """

    initial: Distribution
    xi_0: Array

    @property
    def dimension(self) -> int:
        """The dimension n + l."""
        return self.initial.dimension + self.xi_0.size

    @property
    def mean(self) -> Array:
        """The mean (n + l,)."""
        return frozen(np.concatenate([self.initial.mean, self.xi_0]))

    @property
    def covariance(self) -> Array:
        """The covariance (n + l, n + l), zero in the rows of xi_0."""
        n, covariance = self.initial.dimension, np.zeros((self.dimension, self.dimension))
        covariance[:n, :n] = self.initial.covariance
        return frozen(covariance)

    @property
    def support(self) -> Set | None:
        """None: it lies in a subspace."""
        return None

    @property
    def vertices(self) -> Array:
        """The vertices of the distribution of x_0 over xi_0, (n + l, N); an error when there are none."""
        return frozen(self._above(self.initial.vertices))

    def sample(self, N: int, rng: np.random.Generator) -> Array:
        """Return N independent draws (n + l, N).

        >>> from inc_casadi import Box, Uniform
        >>> StartedFrom(Uniform(Box(0, 1)), np.ones(2)).sample(3, np.random.default_rng(0)).shape
        (3, 3)
        """
        return self._above(self.initial.sample(N, rng))

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return the rule of the distribution of x_0 over xi_0.

        >>> from inc_casadi import Box, Uniform
        >>> StartedFrom(Uniform(Box(0, 1)), np.ones(1)).quadrature(1)[0].tolist()
        [[0.5], [1.0]]
        """
        nodes, weights = self.initial.quadrature(order)
        return self._above(nodes), weights

    def _above(self, x: Array) -> Array:
        return np.vstack([x, np.repeat(self.xi_0[:, None], x.shape[1], axis=1)])


def started(initial: Distribution, controller: LinearController) -> Distribution:
    """Return the distribution of (x_0, xi_0); that of x_0 itself for a static controller.

    >>> from inc_casadi import Box, Uniform
    >>> started(Uniform(Box(0, 1)), LinearController.static([[1.0]])).dimension
    1
    """
    return StartedFrom(initial, controller.xi_0) if controller.order else initial


def dynamic_loop(plant: Any, controller: LinearController) -> Plant:
    """Return the plant with state (x, xi), input u and measurement (y, xi), where the controller is [D_c C_c].

    [x; xi]+ = [[A, 0], [B_c C, A_c]] [x; xi] + [[B], [0]] u, so that u = [D_c C_c] [y; xi] closes the loop of plant and
    controller, and whatever holds for static laws holds for it, from the initial state (x_0, xi_0) (`started`).

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    controller : LinearController that fits it

    Raises
    ------
    DimensionError : the numbers of inputs or measurements differ

    Notes
    -----
    B_c C is rounded, unless C consists of zeros and ones; `static_form` rounds nothing.

    Examples
    --------
    >>> from inc_casadi import INC, simulate
    >>> plant, controller = Plant(1.5, 1.0), LinearController([[0.0]], [[1.0]], [[-0.5]], [[-1.0]])
    >>> law = INC.linear(np.hstack([controller.D_c, controller.C_c]))
    >>> simulate(dynamic_loop(plant, controller), law, [1.0, 0.0], steps=3).x[0].tolist()
    [1.0, 0.5, -0.25, -0.375]
    """
    plant = fitting(plant, controller)
    n, order = plant.n, controller.order
    A = np.block([[plant.A, np.zeros((n, order))], [controller.B_c @ plant.C, controller.A_c]])
    C = np.block([[plant.C, np.zeros((plant.p, order))], [np.zeros((order, n)), np.eye(order)]])
    return Plant(A, np.vstack([plant.B, np.zeros((order, plant.m))]), C, plant.dt)


def static_form(plant: Any, controller: LinearController) -> tuple[Plant, Array]:
    """Return the plant with state (x, xi), input (u, xi+) and measurement (y, xi), and the gain that closes the loop.

    [x; xi]+ = [[A, 0], [0, 0]] [x; xi] + [[B, 0], [0, I]] [u; v] under [u; v] = [[D_c, C_c], [B_c, A_c]] [y; xi]. The
    stored numbers are only rearranged, so a statement about this loop is one about plant and controller, to the bit.

    Parameters
    ----------
    plant, controller : as in `dynamic_loop`

    Raises
    ------
    DimensionError : the numbers of inputs or measurements differ

    Examples
    --------
    >>> static_form(Plant(1.5, 1.0), LinearController([[0.1]], [[0.2]], [[0.3]], [[0.4]]))[1].tolist()
    [[0.4, 0.3], [0.2, 0.1]]
    """
    plant = fitting(plant, controller)
    order = controller.order
    beside = np.zeros((order, order)), np.eye(order), np.eye(order)
    A, B, C = (_diagonal(*pair) for pair in zip((plant.A, plant.B, plant.C), beside, strict=True))
    gain = np.block([[controller.D_c, controller.C_c], [controller.B_c, controller.A_c]])
    return Plant(A, B, C, plant.dt), gain


def _diagonal(first: Array, second: Array) -> Array:
    return np.block([[first, np.zeros((len(first), second.shape[1]))], [np.zeros((len(second), first.shape[1])), second]])
