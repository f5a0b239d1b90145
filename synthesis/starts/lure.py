"""Starts from convex problems: state feedback with W = 0, certified by the sector inequality in the same program."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.activations import Activation, ReLU
from inc_casadi.activations.stack import as_units, sectors
from inc_casadi.arrays import Array, matrix
from inc_casadi.claims import DiscountedCost
from inc_casadi.errors import InfeasibleError, InvalidInputError, SolverError
from inc_casadi.inc import INC, inner_half
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.spec import Spec

INSIDE = 1e-9  # smallest eigenvalue that the program asks for, relative to X
NOTHING = "no feedback was found that the sector inequality certifies"


def state_feedback(plant: Any, claim: DiscountedCost, U: ArrayLike | None = None,
                   activation: Activation | None = None) -> INC:
    """Return u = K x + V phi(U x) with the least cost that the sector inequality certifies, U fixed.

    With X = P^-1, Gamma = Lambda^-1, Y = K X, N = V Gamma the congruence diag(X, Gamma) and Schur's complement make the
    inequality of `DiscountedCost` linear in (X, Gamma, Y, N), for units with phi(z) / z in [0, D]:

        [ M  sqrt(beta) F'  E'Q^(1/2)  G'R^(1/2) ]        M = [ X, -(D U X)'; -D U X, 2 Gamma ],
        [ .  X              0          0         ]  > 0,  F = (A X + B Y, B N),
        [ .  .              I          0         ]        E = (X, 0),  G = (Y, N),
        [ .  .              .          I         ]

    and tr(T) >= tr(P S0), where (T, S0^(1/2); S0^(1/2), X) >= 0, is minimized. Without hidden units this is
    the LQR inequality.

    U: (q, n) rows read the state, none when left out; activation: of all units, ReLU when left out.
    Raises InvalidInputError for a measurement that is not the whole state, or units outside such a sector; InfeasibleError
    and SolverError where nothing is found, NotStabilizableError.

    Source: Boyd et al., Linear Matrix Inequalities in System and Control Theory, ch. 7 and 10; the law K x + V phi(U x),
    Castelan, Tarbouriech, Queinnec, Automatica 44 (2008).

    >>> from inc_casadi import Box, Plant
    >>> law = state_feedback(Plant([[1.0]], [[1.0]]), DiscountedCost([[1.0]], [[1.0]], 1.0, Box([-1.0], [1.0])))
    >>> law.K.round(4).tolist()  # minus the golden ratio's inverse
    [[-0.618]]
    """
    plant = as_plant(plant)
    rows = matrix("U", np.zeros((0, plant.n)) if U is None else U, (None, plant.n))
    units = as_units(activation or ReLU(), len(rows))
    program = _Program(plant, claim, len(rows))
    Y, N = program.unknown(plant.m, plant.n), program.unknown(plant.m, len(rows))
    program.solve(np.diag(_upper(units)) @ rows @ program.out @ program.X, Y, N)
    K, V = Y.value @ program.back, N.value / program.gamma.value if len(rows) else np.zeros((plant.m, 0))
    from_y = np.linalg.inv(plant.C)
    return INC(np.zeros((len(rows),) * 2), rows @ from_y, V, K @ from_y, activation=units)


def saturated_feedback(plant: Any, claim: DiscountedCost, limits: Box) -> INC:
    """Return u = sat(K x) with the least cost that the sector inequality certifies everywhere.

    As in `state_feedback`, with the saturation units' readout V = diag(h) fixed and U free: N = diag(h) Gamma, Y = 0, and
    the product U X is the unknown. The sector of the saturation holds u = 0, so sqrt(beta) A must be stable, and no bound
    below the open loop's cost can be had (`alternate`).

    limits: a Box about 0. Raises InvalidInputError for another box; InfeasibleError where sqrt(beta) A is not stable, for
    then no law of this kind has a cost that the inequality certifies; SolverError where CVXPY or its solver fails.

    >>> from inc_casadi import Plant
    >>> claim = DiscountedCost([[1.0]], [[0.1]], 0.95, Box([-1.0], [1.0]))
    >>> saturated_feedback(Plant([[0.9]], [[1.0]]), claim, Box([-1.0], [1.0]))([5.0]).tolist()
    [-1.0]
    """
    plant = as_plant(plant)
    center, half = inner_half(limits)
    if limits.dimension != plant.m or np.any(center != 0.0):
        raise InvalidInputError(f"limits must be a box about 0 in R^{plant.m}, since u = sat(K x) is 0 at x = 0")
    program = _Program(plant, claim, plant.m)
    endless = costs_without_end(plant, claim.discount)
    if endless:
        raise InfeasibleError(endless)
    L = program.unknown(plant.m, plant.n)
    program.solve(L, np.zeros((plant.m, plant.n)), np.diag(half) @ program.Gamma)
    gain = half[:, None] * (L.value @ program.back)
    law = INC.linear(gain @ np.linalg.inv(plant.C))
    return law.with_saturated_output(limits)


def costs_without_end(plant: Plant, discount: float) -> str:
    """Return why no bounded feedback of a plant has a cost that the sector inequality certifies everywhere, or "".

    >>> costs_without_end(Plant([[1.1]], [[1.0]]), 0.81)
    ''
    """
    radius = float(np.sqrt(discount) * np.max(np.abs(np.linalg.eigvals(plant.A))))
    if radius < 1:
        return ""
    return ("no u = sat(K x) has a cost that the sector inequality certifies everywhere: u = 0 is in the sector of the "
            f"saturation, and sqrt(discount) A has the spectral radius {radius:.6g}, not below 1, so the open loop costs "
            "without end; a proof from a bounded set is what may be had (`certified_linear_start`)")


class _Program:
    """The inequality in X, Gamma and what a caller adds, in coordinates z = S x where the LQR costs z'z: S'S = P.

    What is to be found is then of size 1, whatever the units of the states.
    """

    def __init__(self, plant: Plant, claim: DiscountedCost, units: int) -> None:
        if plant.p != plant.n or abs(np.linalg.det(plant.C)) < 1e-12:
            raise InvalidInputError(f"the inequality is convex for state feedback only, but C ({plant.p} x {plant.n}) does "
                                    "not give the whole state")
        claim.check(plant, INC.linear(np.zeros((plant.m, plant.p))))
        self.cp = _cvxpy()
        self.into, self.out = _coordinates(plant, claim)
        self.plant, self.claim, self.units = plant, claim, units
        self.X = self.cp.Variable((plant.n, plant.n), symmetric=True)
        self.gamma = self.cp.Variable(max(units, 1), nonneg=True)

    def unknown(self, rows: int, columns: int) -> Any:
        """Return an unknown matrix; without columns an array."""
        return self.cp.Variable((rows, columns)) if columns else np.zeros((rows, 0))

    @property
    def Gamma(self) -> Any:
        """diag(gamma)."""
        return self.cp.diag(self.gamma)

    @property
    def back(self) -> Array:
        """X^-1 S at the solution: what takes Y and the like back to the states x."""
        return np.linalg.inv(self.X.value) @ self.into

    def solve(self, reads: Any, Y: Any, N: Any) -> None:
        """Minimize the bound; reads: D U X (units, n)."""
        cp, plant, claim, X, q = self.cp, self.plant, self.claim, self.X, self.units
        beta, n, m = np.sqrt(claim.discount), plant.n, plant.m
        A, B, Q = self.into @ plant.A @ self.out, self.into @ plant.B, self.out.T @ claim.Q @ self.out
        ahead, stage, effort = beta * (A @ X + B @ Y), _root(Q) @ X, _root(claim.R) @ Y
        rows = [[X, ahead.T, stage.T, effort.T], [ahead, X, np.zeros((n, n)), np.zeros((n, m))],
                [stage, np.zeros((n, n)), np.eye(n), np.zeros((n, m))],
                [effort, np.zeros((m, n)), np.zeros((m, n)), np.eye(m)]]
        if q:
            turn, cost = beta * (B @ N), _root(claim.R) @ N
            hidden = [-reads, turn.T, np.zeros((q, n)), cost.T]
            rows = [[*row, part.T] for row, part in zip(rows, hidden, strict=True)] + [[*hidden, 2 * self.Gamma]]
        big = cp.bmat(rows)
        T = cp.Variable((n, n), symmetric=True)
        moment = self.into @ claim.initial.second_moment @ self.into.T
        root = _root(moment / np.trace(moment))
        bound = cp.bmat([[T, root], [root, X]])
        slack = INSIDE * np.eye(big.shape[0])
        problem = cp.Problem(cp.Minimize(cp.trace(T)), [(big + big.T) / 2 >> slack, (bound + bound.T) / 2 >> 0])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an inaccurate start is judged by whoever certifies it
            try:
                problem.solve(solver="CLARABEL")
            except cp.error.SolverError as error:
                raise SolverError(f"{NOTHING}: Clarabel gave up on a program of {big.shape[0]} rows for numerical reasons, "
                                  "which decides nothing") from error
        if "infeasible" in problem.status:
            raise InfeasibleError(f"{NOTHING}: Clarabel finds the program infeasible, which is evidence and no proof")
        if X.value is None or not np.all(np.isfinite(X.value)) or not np.linalg.eigvalsh(X.value)[0] > 0:
            raise SolverError(f"{NOTHING}: Clarabel ended with the status {problem.status!r} and without a usable point")


def _coordinates(plant: Plant, claim: DiscountedCost) -> tuple[Array, Array]:
    """Return S (n, n) with S'S = P of the discounted LQR, and its inverse; directions that cost nothing are lifted a little,
    seen in units of the initial states."""
    _, P = discounted_lqr(plant, Spec(claim.Q, claim.R, claim.discount, claim.initial))
    spread = np.sqrt(np.diag(claim.initial.second_moment))
    units = np.where(spread > 0, spread, 1.0)
    values, vectors = np.linalg.eigh(units[:, None] * P * units)
    sizes = np.sqrt(np.maximum(values, 1e-6 * values[-1])) if values[-1] > 0 else np.ones(len(values))
    return sizes[:, None] * vectors.T / units, units[:, None] * vectors / sizes


def _cvxpy() -> Any:
    try:
        import cvxpy
    except ImportError as error:
        raise SolverError("the convex start needs CVXPY: pip install cvxpy") from error
    return cvxpy


def _root(S: Array) -> Array:
    """Return the symmetric square root of a positive semidefinite matrix."""
    eigenvalues, vectors = np.linalg.eigh(S)
    return (vectors * np.sqrt(np.maximum(eigenvalues, 0.0))) @ vectors.T


def _upper(units: tuple[Activation, ...]) -> Array:
    ends = sectors(units)
    if ends is None or np.any(ends[0] < 0.0):
        raise InvalidInputError("the units must have phi(z) / z in [0, D]: these can be negative, or phi(0) is not 0")
    return ends[1]
