"""Model predictive control: the quadratic program in the inputs alone, and its law as an implicit controller."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from .activations import Saturation
from .arrays import Array, columns, frozen, number, symmetric
from .brief import Brief
from .errors import DimensionError, InfeasibleError, InvalidInputError, NotStabilizableError, SolverError
from .inc import INC, inner_half
from .plant import Plant, as_plant
from .sets import Box, Polytope
from .sets.rules import whole


@dataclass(frozen=True, eq=False)
class Condensed:
    """The program min 1/2 v'H v + v'F x over G v <= w + E x, v the stacked inputs, for states with S x <= s.

    H (N m, N m) > 0; F (N m, n); G (k, N m), w (k,), E (k, n); S (l, n), s (l,): conditions that no input changes.
    """

    H: Array
    F: Array
    G: Array
    w: Array
    E: Array
    S: Array
    s: Array


@dataclass(frozen=True, eq=False)
class MPC(Brief):
    """The law u = first input of the sequence that minimizes a discounted cost over a horizon, within limits.

    Over u_0, ..., u_{N-1} with x_{k+1} = A x_k + B u_k it minimizes

        sum_{k<N} discount^k (x_k'Q x_k + u_k'R u_k) + discount^N x_N'P x_N,

    u_k in `inputs`, x_0, ..., x_{N-1} in `states` and x_N in `terminal_set`, or in `states` where there is none. The cost
    is strictly convex, so the minimizer is unique, and it is continuous and piecewise affine in x_0.

    plant: discrete; Q (n, n) >= 0; R (m, m) > 0; horizon: N >= 1; inputs: a Box in R^m; terminal: P (n, n) >= 0, the cost
    of the unlimited problem for ever (Riccati) when left out; discount in (0, 1]; states, terminal_set: Box or Polytope.

    Raises InvalidInputError, DimensionError; NotStabilizableError when P is left out and does not exist.

    >>> law = MPC(Plant([[1.2]], [[1.0]]), [[1.0]], [[1.0]], 3, Box([-1.0], [1.0]))
    >>> law.inc()([0.5]).round(6).tolist() == law.solve([0.5])[0].round(6).tolist()
    True
    """

    plant: Plant
    Q: Array
    R: Array
    horizon: int
    inputs: Box
    terminal: Array = None  # type: ignore[assignment]
    discount: float = 1.0
    states: Box | Polytope | None = None
    terminal_set: Box | Polytope | None = None

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, plant: Plant, Q: ArrayLike, R: ArrayLike, horizon: int, inputs: Box,
                     terminal: ArrayLike | None = None, discount: float = 1.0, states: Box | Polytope | None = None,
                     terminal_set: Box | Polytope | None = None) -> None: ...

    def __post_init__(self) -> None:
        plant = as_plant(self.plant)
        if not plant.discrete:
            raise InvalidInputError("model predictive control needs a plant in discrete time: plant.sampled(dt)")
        if not isinstance(self.inputs, Box):
            raise InvalidInputError(f"inputs must be a Box, not {self.inputs!r}")
        for name, limits, size in (("inputs", self.inputs, plant.m), ("states", self.states, plant.n),
                                   ("terminal_set", self.terminal_set, plant.n)):
            if limits is not None and limits.dimension != size:
                raise DimensionError(f"{name} is a set in R^{limits.dimension}, but the plant needs R^{size}")
        values = {
            "plant": plant, "Q": symmetric("Q", self.Q, plant.n, definite="semi"),
            "R": symmetric("R", self.R, plant.m, definite="strict"), "horizon": whole("horizon", self.horizon, 1),
            "discount": number("discount", self.discount, 0.0, 1.0, open_low=True),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        terminal = self._riccati() if self.terminal is None else self.terminal
        object.__setattr__(self, "terminal", symmetric("terminal", terminal, plant.n, definite="semi"))

    def inc(self) -> INC:
        """Return the same law as an INC with m N saturation units; for a box of inputs as the only limit.

        With u_k = c + h v_k, |v_k| <= 1, the program is min 1/2 v'M v + v'(L x + l) over the unit box, and v solves it
        exactly when v = sat((I - g M) v - g (L x + l)), for any g > 0: that is its optimality condition. W = I - g M is
        well posed with T = I, since 2 I - W - W' = 2 g M > 0. g is one over the largest eigenvalue of M. W is as rounded to
        floats, so the law is that of a program that differs by rounding.

        Raises InvalidInputError with state limits (their multipliers need not be unique: use
        `pieces.critical_regions.CriticalRegions`) and where the measurement is not the state.
        """
        if self.states is not None or self.terminal_set is not None:
            raise InvalidInputError("this law has state limits: as a fixed point it would need unique multipliers, which it "
                                    "need not have; CriticalRegions evaluates it exactly")
        if not self.plant.full_state:
            raise InvalidInputError("the law reads the state, but the plant measures y = C x with C not the identity")
        center, half = inner_half(self.inputs)
        middle, scale = np.tile(center, self.horizon), np.tile(half, self.horizon)
        M = scale[:, None] * self.condensed.H * scale
        M = (M + M.T) / 2
        step = 1.0 / float(np.linalg.eigvalsh(M)[-1])
        m, size = self.plant.m, len(M)
        V = np.zeros((m, size))
        V[:, :m] = np.diag(half)
        return INC(np.eye(size) - step * M, -step * scale[:, None] * self.condensed.F, V, np.zeros((m, self.plant.n)),
                   -step * scale * (self.condensed.H @ middle), center, Saturation())

    @cached_property
    def condensed(self) -> Condensed:
        """The program with the states eliminated: x_1, ..., x_N stacked are Phi x + Gamma v."""
        n, m, N = self.plant.n, self.plant.m, self.horizon
        Phi, Gamma = self._prediction
        weight = np.kron(np.diag(self.discount ** np.arange(1.0, N + 1)), self.Q)
        weight[-n:, -n:] = self.discount**N * self.terminal
        effort = np.kron(np.diag(self.discount ** np.arange(float(N))), self.R)
        H = Gamma.T @ weight @ Gamma + effort
        rows, E = [np.eye(N * m), -np.eye(N * m)], [np.zeros((2 * N * m, n))]
        w = [np.tile(self.inputs.upper, N), -np.tile(self.inputs.lower, N)]
        S, s = [np.zeros((0, n))], [np.zeros(0)]
        for k, limits in enumerate([self.states] * N + [self.terminal_set or self.states]):
            if limits is None:
                continue
            free, forced = (np.eye(n), np.zeros((n, N * m))) if k == 0 else (
                Phi[n * (k - 1): n * k], Gamma[n * (k - 1): n * k])
            touched = np.any(limits.H @ forced != 0, axis=1)
            rows.append(limits.H[touched] @ forced)
            E.append(-limits.H[touched] @ free)
            w.append(limits.h[touched])
            S.append(limits.H[~touched] @ free)
            s.append(limits.h[~touched])
        parts = ((H + H.T) / 2, Gamma.T @ weight @ Phi, np.vstack(rows), np.concatenate(w), np.vstack(E), np.vstack(S),
                 np.concatenate(s))
        return Condensed(*(frozen(part) for part in parts))

    def solve(self, x: ArrayLike) -> Array:
        """Return the inputs (N, m) that minimize the cost from x (n,), by the interior-point solver Clarabel, to about 1e-8.

        Raises InfeasibleError when no sequence keeps the limits, SolverError when the solver stops early.
        """
        import clarabel
        from scipy import sparse

        point = columns("x", x, self.plant.n)[0][:, 0]
        program = self.condensed
        bound = program.w + program.E @ point
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        if np.any(program.S @ point > program.s):
            raise InfeasibleError(f"x = {point.tolist()} violates a state limit that no input can change")
        solver = clarabel.DefaultSolver(sparse.triu(sparse.csc_matrix(program.H)).tocsc(), program.F @ point,
                                        sparse.csc_matrix(program.G), bound, [clarabel.NonnegativeConeT(len(bound))],
                                        settings)
        found = solver.solve()
        if "Infeasible" in str(found.status):
            raise InfeasibleError(f"no sequence of {self.horizon} inputs from x = {point.tolist()} keeps the limits")
        if "Solved" not in str(found.status):
            raise SolverError(f"the quadratic program at x = {point.tolist()} was not solved: {found.status}")
        return np.array(found.x).reshape(self.horizon, self.plant.m)

    @property
    def _prediction(self) -> tuple[Array, Array]:
        n, m, N = self.plant.n, self.plant.m, self.horizon
        powers = [np.linalg.matrix_power(self.plant.A, k) for k in range(N + 1)]
        Gamma = np.zeros((n * N, m * N))
        for k in range(N):
            for j in range(k + 1):
                Gamma[n * k: n * (k + 1), m * j: m * (j + 1)] = powers[k - j] @ self.plant.B
        return np.vstack(powers[1:]), Gamma

    def _riccati(self) -> Array:
        from scipy.linalg import LinAlgError, solve_discrete_are

        root = np.sqrt(self.discount)
        try:
            P = solve_discrete_are(root * self.plant.A, root * self.plant.B, self.Q, self.R)
        except LinAlgError as error:
            raise NotStabilizableError("no terminal cost was given, and the Riccati equation has no stabilizing "
                                       f"solution: {error}") from error
        return np.asarray((P + P.T) / 2)
