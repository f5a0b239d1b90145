"""The claim of a region of attraction: what happens from every point of an ellipsoid around the equilibrium."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, matrix, number, symmetric
from ..brief import Brief
from ..errors import DimensionError, InvalidInputError
from ..inc import INC
from ..plant import Plant
from ..sets import Box, Polytope

SHAPES = ("volume", "reach", "mean")


@dataclass(frozen=True, eq=False)
class Attraction(Brief):
    """Every motion from an ellipsoid E around the equilibrium x* stays in it, within limits, and converges. Sufficient.

    With e = x - x*, V(e) = e'P e and E = {V <= 1}, for every start in E:

    * the motion stays in E and V(x+) < V(x) for e != 0 (dV/dt < 0), so it converges to x*; with a rate,
      V(x+) <= rate^2 V(x) in discrete time, V(x(t)) <= exp(-rate t) V(x(0)) in continuous time;
    * every input lies in `inputs` and every state in `states`, where these are given;
    * with Q and R, in discrete time, sum_k discount^k (e_k'Q e_k + v_k'R v_k) <= e_0'P_cost e_0, where v = u - u*: the cost
      is counted from the equilibrium, and P_cost is a matrix of its own beside P.

    The proof: an inequality that holds for all points of E gives the decrease of V there, so a motion that starts in E
    never leaves it, and the inequality holds again at its next point. Likewise discount e_+'P_cost e_+ - e'P_cost e +
    e'Qe + v'Rv <= 0 in E is summed with the weights discount^k (thm:performance, along motions that stay in E).

    What is maximized: shape "volume", the volume of E; "reach", the largest s with s d_j in x* + E for every column
    d_j of `directions`, counted from x*; "mean", s = (mean_j d_j'P d_j)^(-1/2), which trades the directions off. The
    cost bound comes second: of all P_cost over the ellipsoid found, one of smallest mean over E is sought. A rate
    leaves room for it; the largest ellipsoid alone may be one where motions from its rim converge very slowly.

    inputs: Box or Polytope in R^m, or None; states: Box or Polytope in R^n, or None; Q (n, n), R (m, m) positive
    semidefinite, both or neither; discount in (0, 1]; rate: in (0, 1) per step, or positive in 1/s, or None; shape: None
    stands for "volume", or "reach" with directions; directions: (n, k), no column zero.

    Raises InvalidInputError, DimensionError.

    >>> Attraction(inputs=Box([-1.0], [1.0]), directions=[[1.0], [1.0]]).shape
    'reach'
    """

    inputs: Box | Polytope | None = None
    states: Box | Polytope | None = None
    Q: Array | None = None
    R: Array | None = None
    discount: float = 1.0
    rate: float | None = None
    shape: str = None  # type: ignore[assignment]  # None is replaced by what the directions suggest
    directions: Array | None = None

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, inputs: Box | Polytope | None = None, states: Box | Polytope | None = None,
                     Q: ArrayLike | None = None, R: ArrayLike | None = None, discount: float = 1.0,
                     rate: float | None = None, shape: str | None = None,
                     directions: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        for name, limits in (("inputs", self.inputs), ("states", self.states)):
            if limits is not None and not isinstance(limits, Box | Polytope):
                raise InvalidInputError(f"{name} must be a Box, a Polytope or None, not {limits!r}")
        if (self.Q is None) != (self.R is None):
            raise InvalidInputError(f"{'R' if self.R is None else 'Q'} is missing: a cost needs both Q and R")
        if self.Q is not None and self.R is not None:
            object.__setattr__(self, "Q", symmetric("Q", self.Q, definite="semi"))
            object.__setattr__(self, "R", symmetric("R", self.R, definite="semi"))
        object.__setattr__(self, "discount", number("discount", self.discount, 0.0, 1.0, open_low=True))
        if self.rate is not None:
            object.__setattr__(self, "rate", number("rate", self.rate, 0.0, open_low=True))
        self._settle_shape()

    def _settle_shape(self) -> None:
        if self.directions is not None:
            directions = matrix("directions", self.directions)
            for j in np.flatnonzero(~directions.any(axis=0)):
                raise InvalidInputError(f"directions has a zero column, number {j}")
            if directions.shape[1] == 0:
                raise InvalidInputError("directions has no column")
            object.__setattr__(self, "directions", directions)
        shape = self.shape or ("volume" if self.directions is None else "reach")
        if shape not in SHAPES:
            raise InvalidInputError(f"shape is {self.shape!r}, but must be one of {', '.join(map(repr, SHAPES))}")
        if (shape == "volume") != (self.directions is None):
            raise InvalidInputError(f"shape {shape!r} {'takes no' if shape == 'volume' else 'needs'} directions")
        object.__setattr__(self, "shape", shape)

    @property
    def has_cost(self) -> bool:
        """Whether a bound on the discounted cost is asked for."""
        return self.Q is not None

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise DimensionError when the claim does not fit the plant, InvalidInputError for an impossible rate or cost."""
        sizes = {"inputs": (self.inputs and self.inputs.dimension, plant.m),
                 "states": (self.states and self.states.dimension, plant.n),
                 "Q": (None if self.Q is None else self.Q.shape[0], plant.n),
                 "R": (None if self.R is None else self.R.shape[0], plant.m),
                 "directions": (None if self.directions is None else self.directions.shape[0], plant.n)}
        for name, (found, wanted) in sizes.items():
            if found is not None and found != wanted:
                raise DimensionError(f"{name} is of size {found}, but the plant has {wanted}")
        if plant.discrete and self.rate is not None and self.rate >= 1.0:
            raise InvalidInputError(f"rate = {self.rate:g} is outside (0, 1): in discrete time V shrinks by rate^2 in "
                                    "every step")
        if not plant.discrete and self.has_cost:
            raise InvalidInputError("the discounted cost is a sum over steps, so Q and R need a discrete plant: sample it "
                                    "first, plant.sampled(dt)")

    def merit(self, P: Array) -> float:
        """Return how large {e'P e <= 1} is in what is maximized: -log det P / 2, or the scale s; larger is better.

        >>> Attraction(directions=[[2.0]]).merit(np.array([[1.0]]))
        0.5
        """
        if self.directions is None:
            sign, logdet = np.linalg.slogdet(P)
            return -float(logdet) / 2 if sign > 0 else -np.inf
        sizes = np.sum(self.directions * (P @ self.directions), axis=0)
        size = float(np.max(sizes) if self.shape == "reach" else np.mean(sizes))
        return size ** -0.5 if size > 0 else -np.inf
