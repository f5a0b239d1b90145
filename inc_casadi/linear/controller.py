"""The linear dynamic controller: a state of its own, started from a fixed value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, columns, matrix, vector
from ..brief import Brief
from ..errors import DimensionError, InvalidInputError


@dataclass(frozen=True, eq=False)
class LinearController(Brief):
    """A linear controller of finite order, xi_{k+1} = A_c xi_k + B_c y_k, u_k = C_c xi_k + D_c y_k, from a fixed xi_0.

    It is the class that lower bounds on linear controllers speak about. With order 0 it is the static law u = D_c y. A
    nonzero xi_0 is how a linear controller comes by constants: u_0 = D_c y_0 + C_c xi_0.

    Parameters
    ----------
    A_c : (l, l), per step; l is the order
    B_c : (l, p), from the measurement
    C_c : (m, l), in the units of the input
    D_c : (m, p), from the measurement to the input at once
    xi_0 : (l,) initial state, None for zero

    Raises
    ------
    DimensionError : the shapes do not fit
    InvalidInputError : a NaN or an infinity

    Notes
    -----
    Source: sec:general_certificate.

    Examples
    --------
    >>> delay = LinearController([[0.0]], [[1.0]], [[-0.5]], [[0.0]])  # u_k = -0.5 y_{k-1}
    >>> xi, u = delay.step(delay.xi_0, [2.0])
    >>> delay.order, u.tolist(), delay.step(xi, [0.0])[1].tolist()
    (1, [0.0], [-1.0])
    """

    A_c: Array
    B_c: Array
    C_c: Array
    D_c: Array
    xi_0: Array = None  # type: ignore[assignment]  # None is replaced by zero

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, A_c: ArrayLike, B_c: ArrayLike, C_c: ArrayLike, D_c: ArrayLike,
                     xi_0: ArrayLike | None = None) -> None: ...

    def __post_init__(self) -> None:
        D_c = matrix("D_c", self.D_c)
        if 0 in D_c.shape:
            raise DimensionError(f"D_c has shape {D_c.shape}, but a controller needs an input and a measurement")
        A_c = matrix("A_c", self.A_c)
        if A_c.shape[0] != A_c.shape[1]:
            raise DimensionError(f"A_c has shape {A_c.shape}, but must be square")
        m, p, order = *D_c.shape, len(A_c)
        values = {"A_c": A_c, "B_c": matrix("B_c", self.B_c, (order, p)), "C_c": matrix("C_c", self.C_c, (m, order)),
                  "D_c": D_c, "xi_0": vector("xi_0", np.zeros(order) if self.xi_0 is None else self.xi_0, order)}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def order(self) -> int:
        """The number l of its states."""
        return len(self.A_c)

    @property
    def m(self) -> int:
        """The number of inputs of the plant that it sets."""
        return self.D_c.shape[0]

    @property
    def p(self) -> int:
        """The number of measurements that it reads."""
        return self.D_c.shape[1]

    @classmethod
    def static(cls, F: ArrayLike) -> LinearController:
        """Return the law u = F y, of order 0; F (m, p).

        >>> LinearController.static([[-1.0, -2.0]]).order
        0
        """
        D_c = matrix("F", F)
        m, p = D_c.shape
        return cls(np.zeros((0, 0)), np.zeros((0, p)), np.zeros((m, 0)), D_c)

    @classmethod
    def from_control(cls, system: Any, xi_0: ArrayLike | None = None) -> LinearController:
        """Return the controller of a python-control `StateSpace` in discrete time, from y to u.

        Parameters
        ----------
        system : control.StateSpace with dt > 0; the sign is as it stands, u = system(y) and not u = -system(y)
        xi_0 : (l,) initial state, None for zero

        Raises
        ------
        InvalidInputError : not a StateSpace, or in continuous time

        >>> import control
        >>> LinearController.from_control(control.ss([[0.5]], [[1.0]], [[2.0]], [[0.0]], 0.1)).C_c.tolist()
        [[2.0]]
        """
        A, B, C, D = (getattr(system, name, None) for name in "ABCD")
        if A is None or B is None or C is None or D is None:
            raise InvalidInputError(f"a controller is read from a control.StateSpace, not from a {type(system).__name__}")
        if not system.dt:
            raise InvalidInputError(f"the controller has dt = {system.dt}, but must be in discrete time (dt > 0): sample it")
        return cls(A, B, C, D, xi_0)

    def step(self, xi: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Return the next state and the input at state xi (l,) and measurement y (p,), or for columns of both.

        >>> LinearController.static([[2.0]]).step([], [3.0])[1].tolist()
        [6.0]
        """
        y, single = columns("y", y, self.p)
        xi = np.reshape(np.asarray(xi, dtype=float), (self.order, y.shape[1]))
        after, u = self.A_c @ xi + self.B_c @ y, self.C_c @ xi + self.D_c @ y
        return (after[:, 0], u[:, 0]) if single else (after, u)

    def scaled(self, t: float) -> LinearController:
        """Return the controller with its output times t.

        >>> LinearController.static([[2.0]]).scaled(0.5).D_c.tolist()
        [[1.0]]
        """
        return LinearController(self.A_c, self.B_c, t * self.C_c, t * self.D_c, self.xi_0)
