"""What is asked of a controller: a discounted quadratic cost from random initial states, under input limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from .arrays import Array, number, symmetric
from .brief import Brief
from .errors import DimensionError, InvalidInputError
from .plant import as_plant
from .sets import Box, Distribution, Polytope, Set, as_distribution


@dataclass(frozen=True, eq=False)
class Spec(Brief):
    """The specification of a control problem, read by claims, bounds and `synthesize`.

    Minimize J = E sum_k discount^k (x_k'Q x_k + u_k'R u_k) over the distribution of x_0, with u_k in `inputs` at all
    times (the cost of thm:performance). How to search is not part of it.

    Parameters
    ----------
    Q : (n, n) symmetric positive semidefinite, the cost of the state per step, in continuous time per second
    R : (m, m) symmetric positive semidefinite, the cost of the input, likewise; may be zero
    discount : factor per step, in continuous time per second, in (0, 1], called beta in the paper
    initial : distribution of x_0 in R^n; a bare Box, Polytope or Ellipsoid stands for the uniform one
    inputs : Box or Polytope in R^m that every input must stay in, or None for no limit

    Raises
    ------
    DimensionError : initial is not in R^n, or inputs not in R^m
    InvalidInputError : Q or R not symmetric positive semidefinite, discount outside (0, 1], or the wrong kind of thing

    Examples
    --------
    >>> from inc_casadi import Box
    >>> spec = Spec(Q=[[1, 0], [0, 1]], R=0.1, discount=0.95, initial=Box([-1, -2], [1, 2]), inputs=Box([-1], [1]))
    >>> spec.n, spec.m, spec.initial.mean.tolist()
    (2, 1, [0.0, 0.0])
    """

    Q: Array
    R: Array
    discount: float
    initial: Distribution
    inputs: Box | Polytope | None = None

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, Q: ArrayLike, R: ArrayLike, discount: float, initial: Distribution | Set,
                     inputs: Box | Polytope | None = None) -> None: ...

    def __post_init__(self) -> None:
        Q = symmetric("Q", self.Q, definite="semi")
        R = symmetric("R", self.R, definite="semi")
        for name, weight in (("Q", Q), ("R", R)):
            if weight.shape[0] == 0:
                raise DimensionError(f"{name} has shape {weight.shape}, but needs at least one row")
        discount = number("discount", self.discount, 0.0, 1.0, open_low=True)
        initial = as_distribution(self.initial)
        if initial.dimension != Q.shape[0]:
            raise DimensionError(f"initial is a distribution on R^{initial.dimension}, but Q has shape {Q.shape}")
        _check_inputs(self.inputs, R)
        for name, value in (("Q", Q), ("R", R), ("discount", discount), ("initial", initial)):
            object.__setattr__(self, name, value)

    @property
    def n(self) -> int:
        """The number of states that Q weighs."""
        return self.Q.shape[0]

    @property
    def m(self) -> int:
        """The number of inputs that R weighs."""
        return self.R.shape[0]

    def check(self, plant: Any) -> Spec:
        """Return the spec itself if it fits the plant.

        Parameters
        ----------
        plant : Plant or control.StateSpace

        Raises
        ------
        DimensionError : Q, initial, R or inputs do not fit its states and inputs
        InvalidInputError : not a plant

        >>> from inc_casadi import Box, Plant
        >>> Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1)).check(Plant(0.5, 1.0)).n
        1
        """
        plant = as_plant(plant)
        if plant.n != self.n:
            raise DimensionError(f"Q has shape {self.Q.shape} and initial is on R^{self.n}, but the plant has "
                                 f"{plant.n} states (A has shape {plant.A.shape})")
        if plant.m != self.m:
            limits = "" if self.inputs is None else f" and inputs is a set in R^{self.m}"
            raise DimensionError(f"R has shape {self.R.shape}{limits}, but the plant has {plant.m} inputs "
                                 f"(B has shape {plant.B.shape})")
        return self


def _check_inputs(inputs: Any, R: Array) -> None:
    if inputs is None:
        return
    if not isinstance(inputs, Box | Polytope):
        raise InvalidInputError(f"inputs must be a Box, a Polytope or None, not {type(inputs).__name__}")
    if inputs.dimension != R.shape[0]:
        raise DimensionError(f"inputs is a set in R^{inputs.dimension}, but R has shape {R.shape}")
