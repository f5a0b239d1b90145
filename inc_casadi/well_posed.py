"""Is the fixed point eta = phi(W eta + c) unique for every c, and how steep is the controller?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from . import exact, monotone
from .arrays import Array
from .brief import Brief
from .monotone import Multiplier, Slopes


@dataclass(frozen=True, eq=False)
class WellPosedness(Brief):
    """The Perron-Frobenius test of thm:wellposed and, when it fails, a multiplier T. Sufficient, not necessary.

    With S the diagonal of the units' largest absolute slopes, |phi(r) - phi(s)| <= S |r - s|. If
    lambda_pf(S |W|) < 1, the fixed point is unique for every c, because eta -> phi(W eta + c) contracts in the
    norm max_i |eta_i| / v_i for any v > 0 with S |W| v < v; and
    |eta(y1) - eta(y2)| <= (I - S|W|)^{-1} S |U| |y1 - y2|, |u(y1) - u(y2)| <= (|K| + |V| (I - S|W|)^{-1} S|U|) |y1 - y2|.
    For S = I these are eq:pf_condition, eq:hidden_lipschitz and eq:controller_lipschitz.

    Else a diagonal T > 0 with He((I - LW)'T(I - SW)) > 0, L and S now the smallest and largest slopes, makes the equation
    strongly monotone: exactly one solution, but Picard's iteration may diverge (`monotone.condition`). For L = 0 this is
    2T - TSW - W'ST > 0, and |eta(c1) - eta(c2)|_T <= |S (c1 - c2)|_T / monotonicity in the norm |x|_T = sqrt(x'Tx).

    radius: lambda_pf(S |W|). norm: ||S W||_inf. weights: v (q,), with `rate` = max_i (S|W| v)_i / v_i < 1 when it holds.
    hidden_lipschitz (q, p) and lipschitz (m, p): bounds as above, under T those of `monotone.lipschitz_bounds`, infinite
    when no test holds. T (q,): None when Perron-Frobenius holds or none was found; monotonicity: with T, a number such
    that He((I - LW)'T(I - SW)) > 2 monotonicity T, verified with every rounding bounded. form: the matrix of the second
    test in words, empty when it was not made.
    """

    radius: float
    norm: float
    weights: Array
    rate: float
    hidden_lipschitz: Array
    lipschitz: Array
    T: Array | None = None
    monotonicity: float = 0.0
    form: str = ""

    @property
    def contracts(self) -> bool:
        """Whether the weights prove the contraction: S |W| v < v in every component."""
        return self.rate < 1.0

    @property
    def holds(self) -> bool:
        """Whether the fixed point is unique for every c, by either test."""
        return self.contracts or self.T is not None

    @property
    def margin(self) -> float:
        """Distance from failing, positive when a test holds: 1 - rate, or the monotonicity under T."""
        return 1.0 - self.rate if self.T is None else self.monotonicity

    @property
    def multiplier(self) -> Multiplier | None:
        """T with its monotonicity, or None."""
        return None if self.T is None else Multiplier(self.T, self.monotonicity)

    @property
    def test(self) -> str:
        """The test that decided, in words."""
        if self.norm < 1.0:
            return f"infinity norm {self.norm:.6g} < 1 (Perron-Frobenius radius {self.radius:.6g})"
        radius = f"Perron-Frobenius radius {self.radius:.6g}"
        if self.T is not None:
            return f"{self.form} > 0 with smallest eigenvalue at least {2 * self.monotonicity:.6g} relative to T ({radius})"
        if self.contracts:
            return f"{radius} < 1"
        return f"{radius} >= 1" + (f", and no diagonal T > 0 with {self.form} > 0 was found" if self.form else "")


def well_posedness(W: Array, U: Array, V: Array, K: Array, slopes: Slopes) -> WellPosedness:
    """Return the Perron-Frobenius test, and where it fails the search for a multiplier T.

    W (q, q), U (q, p), V (m, q), K (m, p); slopes: the units' smallest and largest, (q,) each.
    Raises SolverError when a search is needed and its solver is missing.

    >>> eye, slopes = np.eye(1), (np.zeros(1), np.ones(1))
    >>> test = well_posedness(np.array([[-3.0]]), eye, eye, 0 * eye, slopes)
    >>> test.holds, test.contracts, test.T.tolist(), test.lipschitz.tolist()
    (True, False, [1.0], [[0.25]])
    """
    first = perron_frobenius(W, U, V, K, np.maximum(*np.abs(slopes)))
    if first.contracts:
        return first
    plain = not slopes[0].any()
    unit = np.all(slopes[1] == 1.0)
    form = ("2T - TW - W'T" if unit else "2T - TSW - W'ST") if plain else "He((I - LW)'T(I - SW))"
    found = monotone.find_multiplier(slopes, W)
    if found is None:
        return replace(first, form=form)
    hidden, outer = monotone.lipschitz_bounds(slopes, W, U, V, K, found.T)
    return replace(first, hidden_lipschitz=hidden, lipschitz=outer, T=found.T, monotonicity=found.monotonicity, form=form)


def is_proved(test: WellPosedness, W: Array, slopes: Slopes) -> bool:
    """Return whether the numbers of a test, its weights or its T, prove well-posedness in exact rational arithmetic.

    With T the monotonicity is proved too, so that `error_from_residual` rests on nothing else.

    >>> slopes, eye = (np.zeros(1), np.ones(1)), np.eye(1)
    >>> [is_proved(well_posedness(w * eye, eye, eye, eye, slopes), w * eye, slopes) for w in (0.5, -3.0, 2.0)]
    [True, True, False]
    """
    if test.T is None:
        return exact.contracts(np.maximum(*np.abs(slopes)), W, test.weights)
    return monotone.lmi_well_posed(slopes, W, test.T, True, test.monotonicity)


def error_from_residual(test: WellPosedness, W: Array, slopes: Slopes, residual: Array, guard: float = 1.0) -> Array:
    """Return e (q,) with |eta^ - eta| <= e whenever |eta^ - phi(W eta^ + c)| <= residual, eta the fixed point.

    Under Perron-Frobenius d = |eta^ - eta| has d <= M d + residual with M = S|W| and lambda_pf(M) < 1, so d <= e for every e
    with M e + residual <= e: such are v max_i(residual_i / v_i) / (1 - rate) and, where this inequality is confirmed with a
    margin far above rounding, the solution of e = (1 + 1e-8) (M e + residual). The smaller is returned, entry by entry. Else
    `monotone.error_from_residual`; infinite when no test holds. guard: a factor above 1 that covers the rounding of rate
    and of these lines.

    >>> slopes, eye = (np.zeros(1), np.ones(1)), np.eye(1)
    >>> error_from_residual(well_posedness(eye / 2, eye, eye, eye, slopes), eye / 2, slopes, np.ones(1)).tolist()
    [2.0]
    """
    if test.T is not None:
        return guard * monotone.error_from_residual(slopes, W, Multiplier(test.T, test.monotonicity), residual)
    room = 1.0 - guard * test.rate
    if room <= 0:
        return np.full(residual.shape, np.inf)
    bound = guard * test.weights * np.max(residual / test.weights, initial=0.0) / room
    M = np.maximum(np.abs(slopes[0]), np.abs(slopes[1]))[:, None] * np.abs(W)
    solved = np.linalg.solve(np.eye(len(M)) - (1 + 1e-8) * M, (1 + 1e-8) * residual)
    confirmed = np.all((1 + 1e-9) * (M @ solved + residual) <= solved)
    return np.minimum(bound, guard * solved) if confirmed else bound


def perron_frobenius(W: Array, U: Array, V: Array, K: Array, slope: Array) -> WellPosedness:
    """Return the test of thm:wellposed for one controller.

    W (q, q), U (q, p), V (m, q), K (m, p); slope (q,): the units' largest absolute slopes.

    >>> test = perron_frobenius(np.array([[0.5]]), np.eye(1), np.eye(1), np.zeros((1, 1)), np.ones(1))
    >>> test.holds, test.radius, test.lipschitz.tolist()
    (True, 0.5, [[2.0]])
    """
    q, p = U.shape
    M = slope[:, None] * np.abs(W)
    radius = float(np.max(np.abs(np.linalg.eigvals(M)), initial=0.0))
    norm = float(np.max(M.sum(axis=1), initial=0.0))
    weights, rate = _contraction_weights(M, radius)
    hidden = np.full((q, p), np.inf)
    if rate < 1.0:
        hidden = np.linalg.solve(np.eye(q) - M, slope[:, None] * np.abs(U))
    outer = np.abs(K) + np.abs(V) @ hidden if rate < 1.0 else np.full(K.shape, np.inf)
    return WellPosedness(radius, norm, weights, rate, hidden, outer)


def _contraction_weights(M: Array, radius: float) -> tuple[Array, float]:
    """Weights v > 0 that make max (M v)_i / v_i small: v = (c I - M)^{-1} 1 with c just above lambda_pf(M)."""
    q = M.shape[0]
    if q == 0:
        return np.ones(0), 0.0
    best = np.ones(q), float(M.sum(axis=1).max())
    for level in (radius + 1e-3 * (1.0 - radius), 0.5 * (1.0 + radius), 1.0):
        if level <= radius or radius >= 1.0:
            continue
        v = np.linalg.solve(level * np.eye(q) - M, np.ones(q))
        if np.all(v > 0) and np.all(np.isfinite(v)):
            v = v / v.max()
            rate = float(np.max((M @ v) / v))
            best = min(best, (v, rate), key=lambda pair: pair[1])
    return best
