"""The implicit neural controller: eta = phi(W eta + U y + b), u = K y + V eta + d."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import fixed_point, monotone
from .activations import Activation, ReLU, Saturation
from .activations.stack import Units, as_units, derivative, lipschitz, sectors, slopes
from .arrays import Array, columns, matrix, vector
from .brief import Brief
from .errors import DimensionError, InvalidInputError, NotWellPosedError
from .sets import Box
from .well_posed import WellPosedness, perron_frobenius, well_posedness

if TYPE_CHECKING:
    from .plant import Plant


class Adjoint(NamedTuple):
    """Gradients of a scalar loss l(u), summed over the points (eq:parameter_gradients); `y` is per point (p, N)."""

    y: Array
    W: Array
    U: Array
    V: Array
    K: Array
    b: Array
    d: Array


@dataclass(frozen=True, eq=False)
class INC(Brief):
    """A static feedback law u = inc(y) through a fixed point: eta = phi(W eta + U y + b), u = K y + V eta + d.

    W: (q, q); U: (q, p); V: (m, q); K: (m, p); b: (q,), zero when left out; d: (m,), zero when left out;
    activation: one `Activation`, or one per hidden unit. y has the units of the measurement, u of the actuator.
    q may be 0: a linear law.

    Any W can be described; evaluation refuses a W whose fixed point is not proved unique, by thm:wellposed or by a
    diagonal T with 2T - TW - W'T > 0 (`WellPosedness`).

    Raises DimensionError when shapes do not fit, InvalidInputError for NaN or infinities.

    >>> inc = INC(W=[[0.5]], U=[[1.0]], V=[[-1.0]], K=[[0.0]])
    >>> inc([1.0]).round(9).tolist()
    [-2.0]
    """

    W: Array
    U: Array
    V: Array
    K: Array
    b: Array = None  # type: ignore[assignment]
    d: Array = None  # type: ignore[assignment]
    activation: Activation | Sequence[Activation] = field(default_factory=ReLU)

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, W: ArrayLike, U: ArrayLike, V: ArrayLike, K: ArrayLike, b: ArrayLike | None = None,
                     d: ArrayLike | None = None, activation: Activation | Sequence[Activation] = ...) -> None: ...

    def __post_init__(self) -> None:
        K = matrix("K", self.K)
        m, p = K.shape
        if m == 0 or p == 0:
            raise DimensionError(f"K has shape {K.shape}, but a controller needs an output and a measurement")
        W = matrix("W", np.zeros((0, 0)) if np.size(self.W) == 0 else self.W)
        q = W.shape[0]
        if W.shape[1] != q:
            raise DimensionError(f"W has shape {W.shape}, but must be square")
        values = {
            "K": K, "W": W,
            "U": matrix("U", np.zeros((0, p)) if q == 0 else self.U, (q, p)),
            "V": matrix("V", np.zeros((m, 0)) if q == 0 else self.V, (m, q)),
            "b": vector("b", np.zeros(q) if self.b is None else self.b, q),
            "d": vector("d", np.zeros(m) if self.d is None else self.d, m),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        units = as_units(self.activation, q)
        if not isinstance(self.activation, Activation):
            object.__setattr__(self, "activation", units)

    @classmethod
    def linear(cls, K: ArrayLike) -> INC:
        """Return the linear law u = K y without hidden units; K (m, p).

        >>> INC.linear([[2.0, 1.0]])([1.0, 1.0]).tolist()
        [3.0]
        """
        K = matrix("K", K)
        return cls(np.zeros((0, 0)), np.zeros((0, K.shape[1])), np.zeros((K.shape[0], 0)), K)

    @classmethod
    def saturated(cls, K: ArrayLike, limit: ArrayLike) -> INC:
        """Return the law u_i = limit_i sat((K y)_i / limit_i) with one saturation unit per input.

        K: (m, p); limit: positive, one number or (m,), in the units of u.

        >>> INC.saturated([[2.0]], 1.0)([3.0]).tolist()
        [1.0]
        """
        K = matrix("K", K)
        bound = np.broadcast_to(vector("limit", limit), (K.shape[0],)) if np.size(limit) == 1 else vector("limit", limit)
        if np.any(bound <= 0):
            raise InvalidInputError(f"limit must be positive, but its smallest entry is {bound.min():g}")
        return cls.linear(K).with_saturated_output(Box(-bound, bound))

    @classmethod
    def from_layers(cls, layers: Sequence[tuple[ArrayLike, ArrayLike]], activation: Activation | None = None) -> INC:
        """Return the feedforward network h_1 = phi(W_1 y + b_1), ..., u = W_L h_{L-1} + b_L, stacked into one eta.

        layers: (W_l, b_l) with W_l (n_l, n_{l-1}) and b_l (n_l,); the last layer is linear. W is strictly block
        triangular, so lambda_pf(|W|) = 0.

        >>> net = INC.from_layers([([[1.0]], [0.0]), ([[2.0]], [1.0])], ReLU())
        >>> net([3.0]).tolist()
        [7.0]
        """
        if not layers:
            raise InvalidInputError("layers is empty: a network needs at least its linear output layer")
        weights = [matrix(f"weight of layer {i + 1}", weight) for i, (weight, _) in enumerate(layers)]
        biases = [vector(f"bias of layer {i + 1}", bias, weights[i].shape[0]) for i, (_, bias) in enumerate(layers)]
        for i in range(1, len(weights)):
            if weights[i].shape[1] != weights[i - 1].shape[0]:
                raise DimensionError(f"layer {i + 1} reads {weights[i].shape[1]} values, but layer {i} gives "
                                     f"{weights[i - 1].shape[0]}")
        if len(layers) == 1:
            law = cls.linear(weights[0])
            return cls(law.W, law.U, law.V, law.K, d=biases[0])
        sizes = [weight.shape[0] for weight in weights[:-1]]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        q, p, m = int(starts[-1]), weights[0].shape[1], weights[-1].shape[0]
        W, U, V = np.zeros((q, q)), np.zeros((q, p)), np.zeros((m, q))
        U[: sizes[0]] = weights[0]
        for i in range(1, len(sizes)):
            W[starts[i]: starts[i + 1], starts[i - 1]: starts[i]] = weights[i]
        V[:, starts[-2]:] = weights[-1]
        return cls(W, U, V, np.zeros((m, p)), np.concatenate(biases[:-1]), biases[-1], activation or ReLU())

    @classmethod
    def from_mpc(cls, plant: Plant, Q: ArrayLike, R: ArrayLike, horizon: int, inputs: Box,
                 terminal: ArrayLike | None = None, discount: float = 1.0) -> INC:
        """Return the model predictive law of `mpc.MPC` with a box of inputs, exactly, as m horizon saturation units.

        >>> from inc_casadi import Plant
        >>> INC.from_mpc(Plant([[1.2]], [[1.0]]), [[1.0]], [[1.0]], 3, Box([-1.0], [1.0]))([5.0]).tolist()
        [-1.0]
        """
        from .mpc import MPC
        return MPC(plant, Q, R, horizon, inputs, terminal, discount).inc()

    @classmethod
    def from_affine_pieces(cls, pieces: Any, tol: float | None = None, saturations: bool = False) -> INC:
        """Return a continuous piecewise-affine law exactly, with few ReLU units and W strictly triangular (prop:pwa_relu).

        pieces: of (Box or Polytope in R^p, gain (m, p), offset (m,)) that fill a convex set, or what `regions` returned;
        tol, saturations, and what is refused: see `affine_pieces.represent`, which also tells how exact it is.

        >>> left, right = (Box([-2.0], [0.0]), [[-1.0]], [0.0]), (Box([0.0], [2.0]), [[1.0]], [0.0])
        >>> INC.from_affine_pieces([left, right])([[-1.5, 0.5]]).tolist()
        [[1.5, 0.5]]
        """
        from .affine_pieces import represent
        return represent(pieces, tol, saturations).inc

    @classmethod
    def from_onnx(cls, source: Any, output: str | None = None) -> INC:
        """Return the network of an ONNX file or model; see `interchange.onnx_in`, which checks it point by point."""
        from .interchange.onnx_in import from_onnx
        return from_onnx(source, output)

    @classmethod
    def from_lqr(cls, gain: Any, limits: Box | None = None) -> INC:
        """Return u = -K x of python-control's lqr or dlqr, clipped to limits if given; see `interchange.control_system`.

        >>> INC.from_lqr([[2.0]], Box([-1.0], [1.0]))([[0.25, 3.0]]).tolist()
        [[-0.5, -1.0]]
        """
        from .interchange.control_system import from_lqr
        return from_lqr(gain, limits)

    def with_saturated_output(self, limits: Box) -> INC:
        """Return the law whose output is this one's, clipped to the box; one more saturation unit per input.

        With center c and half width h of the box, u = c + h sat((K y + V eta + d - c) / h): the new units read the
        old ones and nothing reads them back, so lambda_pf is unchanged and |u - c| <= h holds by construction.

        limits: a Box in R^m, in the units of u. h is rounded down until c + h and c - h lie in the box exactly.

        >>> INC.linear([[2.0]]).with_saturated_output(Box([0.0], [1.0]))([[-3.0, 0.25, 3.0]]).tolist()
        [[0.0, 0.5, 1.0]]
        """
        if limits.dimension != self.m:
            raise DimensionError(f"limits is a box in R^{limits.dimension}, but the controller has {self.m} outputs")
        center, half = inner_half(limits)
        scale = 1.0 / half[:, None]
        W = np.block([[self.W, np.zeros((self.q, self.m))], [scale * self.V, np.zeros((self.m, self.m))]])
        return INC(W, np.vstack([self.U, scale * self.K]), np.hstack([np.zeros((self.m, self.q)), np.diag(half)]),
                   np.zeros((self.m, self.p)), np.concatenate([self.b, (self.d - center) / half]), center,
                   self.activations + (Saturation(),) * self.m)

    @property
    def q(self) -> int:
        """Number of hidden units."""
        return self.W.shape[0]

    @property
    def p(self) -> int:
        """Number of measurements."""
        return self.K.shape[1]

    @property
    def m(self) -> int:
        """Number of outputs, the plant's inputs."""
        return self.K.shape[0]

    @cached_property
    def activations(self) -> Units:
        """The activation of each hidden unit, a tuple of length q."""
        return as_units(self.activation, self.q)

    def __repr__(self) -> str:
        """Return its sizes, its activations and the structure of W, which decides the well-posedness.

        >>> INC([[0.3, 0.4], [0.2, 0.1]], [[1.0], [1.0]], [[1.0, 1.0]], [[0.0]], b=[1.0, 0.0])
        INC(q=2, p=1, m=1, ReLU, biased, loops with lambda_pf(S|W|) = 0.5)
        """
        words = [f"q={self.q}", f"p={self.p}", f"m={self.m}", *unit_names(self.activations)]
        if self.b.any() or self.d.any():
            words.append("biased")
        return f"INC({', '.join([*words, self._structure])})"

    @property
    def _structure(self) -> str:
        if self.q == 0:
            return "linear"
        if fixed_point.feedforward_levels(self.W) is not None:
            return "feedforward"
        return f"loops with lambda_pf(S|W|) = {self.contraction.radius:.4g}"

    @property
    def preserves_origin(self) -> bool:
        """Whether b = 0, d = 0 and phi(0) = 0, so that eta = 0 and u = 0 belong to y = 0."""
        return not self.b.any() and not self.d.any() and sectors(self.activations) is not None

    @cached_property
    def contraction(self) -> WellPosedness:
        """The Perron-Frobenius test alone (thm:wellposed), which needs no search. Computed once."""
        return perron_frobenius(self.W, self.U, self.V, self.K, lipschitz(self.activations))

    @cached_property
    def _well_posedness(self) -> WellPosedness:
        return well_posedness(self.W, self.U, self.V, self.K, slopes(self.activations))

    def well_posedness(self) -> WellPosedness:
        """Return the test of Perron-Frobenius (thm:wellposed) or, where it fails, the one with a diagonal T; sufficient.

        It carries the Lipschitz bounds. Computed once.
        """
        return self._well_posedness

    def solve(self, y: ArrayLike, method: str = "auto") -> fixed_point.FixedPoint:
        """Return the hidden fixed points of points y, (p,) or (p, N), with residual and iteration count.

        method: "auto" (one pass when W is feedforward, else the cheaper one that surely converges), "picard", "newton"
        (safeguarded) or "splitting" (`splitting.Splitting`, slower, for any W with a multiplier T).
        Raises NotWellPosedError when the fixed point is not proved unique, ConvergenceError on a residual too large.
        """
        points, _ = columns("y", y, self.p)
        test = self.well_posedness()
        if not test.holds:
            raise NotWellPosedError(
                f"W ({self.q} x {self.q}) is not proved well posed: lambda_pf(S|W|) = {test.radius:.6g} is not below 1 "
                f"(thm:wellposed), and no diagonal T > 0 with {test.form} > 0 was found, so eta = phi(W eta + U y + b) may "
                "have no solution or several")
        T = self._splitting_metric if method == "splitting" else test.T
        return fixed_point.solve(self.W, self.U @ points + self.b[:, None], self.activations, rate=test.rate,
                                 weights=test.weights, T=T, method=method)

    @cached_property
    def _splitting_metric(self) -> Array | None:
        """The multiplier T, searched for where Perron-Frobenius made it unnecessary."""
        test = self.well_posedness()
        found = test.multiplier or monotone.find_multiplier(slopes(self.activations), self.W)
        return None if found is None else found.T

    def hidden(self, y: ArrayLike) -> Array:
        """Return eta for a point y (p,) or columns (p, N): shape (q,) or (q, N)."""
        eta = self.solve(y).eta
        return eta[:, 0] if np.ndim(y) < 2 else eta

    def __call__(self, y: ArrayLike) -> Array:
        """Return u for a point y (p,) or columns (p, N): shape (m,) or (m, N)."""
        points, single = columns("y", y, self.p)
        u = self.K @ points + self.V @ self.solve(points).eta + self.d[:, None]
        return u[:, 0] if single else u

    def jacobian(self, y: ArrayLike) -> Array:
        """Return du/dy = K + V (I - D W)^{-1} D U (eq:inc_output_jacobian), (m, p) or (N, m, p).

        I - D W is nonsingular for every diagonal D of slopes: by lambda_pf(D|W|) < 1, or since x = D W x would make
        x'He((I - LW)'T(I - SW))x <= 0 (`monotone.condition`). At a kink D takes the slope on the right, one of the valid
        generalized derivatives.
        """
        points, single = columns("y", y, self.p)
        eta = self.solve(points).eta
        slope = derivative(self.activations, self.W @ eta + self.U @ points + self.b[:, None]).T[:, :, None]
        sensitivity = np.linalg.solve(np.eye(self.q)[None] - slope * self.W[None], slope * self.U[None])
        jacobian = self.K[None] + self.V[None] @ sensitivity
        return jacobian[0] if single else jacobian

    def adjoint(self, y: ArrayLike, gradient: ArrayLike) -> Adjoint:
        """Return the gradients of a scalar loss with dl/du = gradient at y (prop:implicit_gradients).

        y: (p,) or (p, N); gradient: (m,) or (m, N). Solves v = D (W' v + V' gradient) per point; parameter gradients
        are summed over the points, the gradient to y is (p, N), or (p,) for a single point.
        """
        points, single = columns("y", y, self.p)
        g, _ = columns("gradient", gradient, self.m)
        if g.shape[1] != points.shape[1]:
            raise DimensionError(f"gradient has {g.shape[1]} columns, but y has {points.shape[1]}")
        eta = self.solve(points).eta
        slope = derivative(self.activations, self.W @ eta + self.U @ points + self.b[:, None])
        system = np.eye(self.q)[None] - slope.T[:, :, None] * self.W.T[None]
        v = np.linalg.solve(system, (slope * (self.V.T @ g)).T[:, :, None])[:, :, 0].T
        to_y = self.K.T @ g + self.U.T @ v
        return Adjoint(to_y[:, 0] if single else to_y, v @ eta.T, v @ points.T, g @ eta.T, g @ points.T,
                       v.sum(axis=1), g.sum(axis=1))

    def without_idle_units(self) -> INC:
        """Return the same law without the hidden units that no output depends on.

        >>> INC(np.zeros((2, 2)), [[1.0], [2.0]], [[0.0, 1.0]], [[0.0]]).without_idle_units().q
        1
        """
        used = np.any(self.V != 0, axis=0)
        while True:
            more = used | np.any(self.W[used] != 0, axis=0)
            if np.array_equal(more, used):
                break
            used = more
        rows = np.flatnonzero(used)
        return INC(self.W[np.ix_(rows, rows)], self.U[rows], self.V[:, rows], self.K, self.b[rows], self.d,
                   tuple(self.activations[i] for i in rows))

    def to_casadi(self) -> Any:
        """Return the law as a CasADi Function y -> (u, eta), the fixed point as an implicit rootfinder."""
        from .graph import inc_function
        return inc_function(self)

    def to_c(self, name: str = "inc", **options: Any) -> Any:
        """Return the law as self-contained C with a proved error bound; see `interchange.c_code.to_c`."""
        from .interchange.c_code import to_c
        return to_c(self, name, **options)

    def to_onnx(self, path: Any = None, *, double: bool = True) -> Any:
        """Return a feedforward law as an ONNX model, written to a path if given; see `interchange.onnx_out`."""
        from .interchange.onnx_out import to_onnx
        return to_onnx(self, path, double=double)

    def to_control(self, dt: float | bool | None = None, **names: Any) -> Any:
        """Return the law as a static `control.NonlinearIOSystem` from y to u; see `interchange.control_system`."""
        from .interchange.control_system import to_control
        return to_control(self, dt, **names)


def unit_names(units: Units) -> list[str]:
    """Return the activations in words, with their numbers of units where they differ.

    >>> unit_names((ReLU(), ReLU(), Saturation())), unit_names((ReLU(),))
    (['2 ReLU', '1 Saturation'], ['ReLU'])
    """
    counted = Counter(repr(unit).removesuffix("()") for unit in units)
    return list(counted) if len(counted) == 1 else [f"{number} {name}" for name, number in counted.items()]


def inner_half(limits: Box) -> tuple[Array, Array]:
    """Center and half widths in floats with center +- half within the box in exact arithmetic."""
    center, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    for i in range(half.size):
        c, low, high = Fraction(center[i]), Fraction(limits.lower[i]), Fraction(limits.upper[i])
        while c + Fraction(half[i]) > high or c - Fraction(half[i]) < low:
            half[i] = np.nextafter(half[i], 0.0)
    return center, half
