"""The regional claim: what happens from every point of a set, under hard input limits."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..arrays import Array, number, symmetric
from ..brief import Brief
from ..errors import DimensionError, InvalidInputError
from ..plant import Plant
from ..sets import Box, Polytope, Uniform


@dataclass(frozen=True, eq=False)
class Regional(Brief):
    """From every x0 of a polytope: inputs within limits, convergence, and the exact discounted cost.

    Promise: for every x0 in the support of `initial`, every input of the motion lies in `inputs`, the motion converges
    to the equilibrium, and E sum_k discount^k (x_k'Q x_k + u_k'R u_k) is at most the bound. This is
    eq:nn_admissibility_general and the cost of thm:general_superiority, without a global sector. Necessary and
    sufficient up to the budget of pieces, for piecewise-affine controllers in discrete time.

    initial: Uniform(Box | Polytope), or the bare set, in state units; inputs: Box or Polytope in R^m, or None; Q (n, n) and
    R (m, m) positive semidefinite; discount in (0, 1].

    Raises InvalidInputError, DimensionError.

    >>> Regional(Box([-1.0], [1.0]), Box([-1.0], [1.0]), [[1.0]], [[0.0]], 0.9).initial.dimension
    1
    """

    initial: Uniform
    inputs: Box | Polytope | None
    Q: Array
    R: Array
    discount: float

    def __init__(self, initial: Uniform | Box | Polytope, inputs: Box | Polytope | None, Q: ArrayLike, R: ArrayLike,
                 discount: float = 1.0) -> None:
        start = Uniform(initial) if isinstance(initial, Box | Polytope) else initial
        if not isinstance(start, Uniform) or not isinstance(start.support, Box | Polytope):
            raise InvalidInputError(f"initial must be a Box, a Polytope or a Uniform over one, not {initial!r}: exact "
                                    "pieces cut it into simplices")
        if inputs is not None and not isinstance(inputs, Box | Polytope):
            raise InvalidInputError(f"inputs must be a Box, a Polytope or None, not {inputs!r}")
        values = {
            "initial": start, "inputs": inputs, "Q": symmetric("Q", Q, start.dimension, definite="semi"),
            "R": symmetric("R", R, None if inputs is None else inputs.dimension, definite="semi"),
            "discount": number("discount", discount, 0.0, 1.0, open_low=True),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def check(self, plant: Plant) -> None:
        """Raise DimensionError when the claim does not fit the plant."""
        if self.Q.shape[0] != plant.n or self.R.shape[0] != plant.m:
            raise DimensionError(f"the claim speaks of {self.Q.shape[0]} states and {self.R.shape[0]} inputs, but the "
                                 f"plant has {plant.n} and {plant.m}")
