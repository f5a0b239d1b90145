"""The paper's lower bound on linear controllers: the first move is affine in the measurement."""

from __future__ import annotations

from typing import Any

from ..spec import Spec
from .affine_moves import affine_moves
from .bound import Bound


def first_move(plant: Any, spec: Spec, *, relaxed: bool = False, seconds: float | None = None) -> Bound:
    """Return the bound L_lin on the expected cost of every admissible linear controller, from its first move.

    L_lin = E[x_0'Q x_0] + min E[u_0'R u_0 + beta (A x_0 + B u_0)'Q (A x_0 + B u_0)] over u_0 = D_y C x_0 + d with
    H_u u_0 <= h_u from every initial state that may occur. The paper states it for R = 0; the cost of the first input
    may be counted as well. It is `affine_moves` with one move.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    spec : Spec; initial on a bounded set: any polytope or ellipsoid, any distribution of which the moments are known
    relaxed : write u_0 = D x_0 + d with any D: a bound no larger, in favour of the linear controllers
    seconds : as in `affine_moves`

    Raises
    ------
    InvalidInputError, DimensionError, SolverError : as `affine_moves`

    Notes
    -----
    Source: eq:Jlin_star; an implicit controller with a certified cost below it beats all linear ones
    (thm:general_superiority).

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> bound = first_move(Plant(1.5, 1.0), Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1)))
    >>> round(float(bound), 6)  # 1/3 + 1/12 (thm:longrun_dyn)
    0.416667
    """
    return affine_moves(plant, spec, 1, relaxed=relaxed, seconds=seconds)
