"""The dynamic implicit neural controller: a state of its own beside the hidden units, started from a fixed value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..activations import Activation, ReLU, Saturation
from ..arrays import Array, columns, matrix, vector
from ..brief import Brief
from ..errors import DimensionError, InvalidInputError
from ..inc import INC, inner_half
from ..linear.controller import LinearController
from ..sets import Box


@dataclass(frozen=True, eq=False)
class DynamicINC(Brief):
    """A controller with memory: one static law (y_k, xi_k) -> (u_k, xi_{k+1}), begun at a fixed xi_0.

    eta = phi(W eta + U y + S xi + b),   u = K y + C_c xi + V eta + d,   xi+ = B_c y + A_c xi + E_c eta + a_c.

    The law is an INC with p + l measurements and m + l outputs; what it measures of itself it sets itself one step before.
    So nothing is new but the reading: stacked,

        K_law = [[K, C_c], [B_c, A_c]],  V_law = [V; E_c],  U_law = [U, S],  d_law = [d; a_c],

    and the controller is well posed exactly when the law is. `from_matrices` takes the parts, `from_linear` a linear
    controller.

    Parameters
    ----------
    law : INC with p + l measurements (y, xi) and m + l outputs (u, xi+)
    xi_0 : (l,) the initial state, l >= 1 the order

    Raises
    ------
    DimensionError : the law leaves no measurement or no input beside xi, or there is no xi

    Examples
    --------
    >>> delay = DynamicINC(INC.linear([[0.0, -0.5], [1.0, 0.0]]), [0.0])  # u_k = -0.5 y_{k-1}
    >>> xi, u = delay.step(delay.xi_0, [2.0])
    >>> delay.order, u.tolist(), delay.step(xi, [0.0])[1].tolist()
    (1, [0.0], [-1.0])
    """

    law: INC
    xi_0: Array

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, law: INC, xi_0: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        if not isinstance(self.law, INC):
            raise InvalidInputError(f"law must be an INC, not {type(self.law).__name__}")
        object.__setattr__(self, "xi_0", vector("xi_0", self.xi_0))
        l = self.xi_0.size
        if l == 0:
            raise DimensionError("xi_0 is empty: a controller without a state is an INC")
        if self.law.p <= l or self.law.m <= l:
            raise DimensionError(f"xi_0 has size {l}, so the law needs more than {l} measurements and outputs, but it "
                                 f"has {self.law.p} and {self.law.m}")

    @classmethod
    def from_matrices(cls, *, A_c: ArrayLike, B_c: ArrayLike, C_c: ArrayLike, K: ArrayLike, W: ArrayLike = (),
                      U: ArrayLike = (), S: ArrayLike = (), V: ArrayLike = (), E_c: ArrayLike = (),
                      b: ArrayLike | None = None, d: ArrayLike | None = None, a_c: ArrayLike | None = None,
                      activation: Activation | tuple[Activation, ...] | None = None,
                      xi_0: ArrayLike | None = None) -> DynamicINC:
        """Return the controller of these parts; what is left out is zero.

        Parameters
        ----------
        A_c : (l, l); B_c : (l, p); C_c : (m, l); K : (m, p)
        W : (q, q); U : (q, p); S : (q, l); V : (m, q); E_c : (l, q)
        b : (q,); d : (m,), in the units of the input; a_c : (l,)
        activation : one, or one per hidden unit, ReLU when left out
        xi_0 : (l,)

        Raises
        ------
        DimensionError : the shapes do not fit

        >>> c = DynamicINC.from_matrices(A_c=[[0.0]], B_c=[[1.0]], C_c=[[0.0]], K=[[0.0]], W=[[0.0]], U=[[1.0]], S=[[2.0]],
        ...                              V=[[-1.0]], E_c=[[0.0]])
        >>> c.step([1.0], [3.0])[1].tolist()
        [-5.0]
        """
        K = matrix("K", K)
        A_c = matrix("A_c", A_c)
        (m, p), l, q = K.shape, len(A_c), len(np.atleast_1d(np.asarray(W)))

        def part(name: str, value: ArrayLike, rows: int, width: int) -> Array:
            return matrix(name, np.zeros((rows, width)) if np.size(value) == 0 else value, (rows, width))

        gain = np.block([[K, matrix("C_c", C_c, (m, l))], [matrix("B_c", B_c, (l, p)), matrix("A_c", A_c, (l, l))]])
        law = INC(part("W", W, q, q), np.hstack([part("U", U, q, p), part("S", S, q, l)]),
                  np.vstack([part("V", V, m, q), part("E_c", E_c, l, q)]), gain, b,
                  np.concatenate([vector("d", np.zeros(m) if d is None else d, m),
                                  vector("a_c", np.zeros(l) if a_c is None else a_c, l)]), activation or ReLU())
        return cls(law, np.zeros(l) if xi_0 is None else xi_0)

    @classmethod
    def from_linear(cls, controller: LinearController) -> DynamicINC:
        """Return a linear controller as one without hidden units; its numbers are only rearranged.

        >>> DynamicINC.from_linear(LinearController([[0.1]], [[0.2]], [[0.3]], [[0.4]])).law.K.tolist()
        [[0.4, 0.3], [0.2, 0.1]]
        """
        gain = np.block([[controller.D_c, controller.C_c], [controller.B_c, controller.A_c]])
        return cls(INC.linear(gain), controller.xi_0)

    @property
    def order(self) -> int:
        """The number l of its states."""
        return self.xi_0.size

    @property
    def p(self) -> int:
        """The number of measurements of the plant that it reads."""
        return self.law.p - self.order

    @property
    def m(self) -> int:
        """The number of inputs of the plant that it sets."""
        return self.law.m - self.order

    @property
    def q(self) -> int:
        """The number of hidden units."""
        return self.law.q

    @property
    def readout(self) -> INC:
        """The static law (y, xi) -> u alone: input limits that it keeps for every argument are built in.

        >>> DynamicINC(INC.linear([[0.0, -0.5], [1.0, 0.0]]), [0.0]).readout.K.tolist()
        [[0.0, -0.5]]
        """
        law, m = self.law, self.m
        return INC(law.W, law.U, law.V[:m], law.K[:m], law.b, law.d[:m], law.activations)

    def step(self, xi: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Return the next state and the input at state xi (l,) and measurement y (p,), or for columns of both.

        >>> DynamicINC(INC.linear([[0.0, 2.0], [1.0, 0.0]]), [0.0]).step([[1.0, 2.0]], [[3.0, 4.0]])[1].tolist()
        [[2.0, 4.0]]
        """
        y, single = columns("y", y, self.p)
        xi = np.reshape(np.asarray(xi, dtype=float), (self.order, y.shape[1]))
        both = self.law(np.vstack([y, xi]))
        u, after = both[: self.m], both[self.m:]
        return (after[:, 0], u[:, 0]) if single else (after, u)

    def with_saturated_output(self, limits: Box) -> DynamicINC:
        """Return the controller with its input clipped to the box, m saturation units more; xi+ is as before.

        An observer should know the clipped input: clip its readout instead (`observer`), then E_c feeds it back.

        limits: a Box in R^m, in the units of u; its half widths are rounded inwards, as in `INC.with_saturated_output`.

        >>> held = DynamicINC(INC.linear([[0.0, 2.0], [1.0, 0.0]]), [0.0]).with_saturated_output(Box([-1.0], [1.0]))
        >>> [part.tolist() for part in held.step([4.0], [3.0])]
        [[3.0], [1.0]]
        """
        law, m, l = self.law, self.m, self.order
        if limits.dimension != m:
            raise DimensionError(f"limits is a box in R^{limits.dimension}, but the controller has {m} inputs")
        center, half = inner_half(limits)
        scale = 1.0 / half[:, None]
        W = np.block([[law.W, np.zeros((law.q, m))], [scale * law.V[:m], np.zeros((m, m))]])
        V = np.block([[np.zeros((m, law.q)), np.diag(half)], [law.V[m:], np.zeros((l, m))]])
        return DynamicINC(INC(W, np.vstack([law.U, scale * law.K[:m]]), V, np.vstack([np.zeros_like(law.K[:m]), law.K[m:]]),
                              np.concatenate([law.b, (law.d[:m] - center) / half]), np.concatenate([center, law.d[m:]]),
                              (*law.activations, *(Saturation(),) * m)), self.xi_0)
