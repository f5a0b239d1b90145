"""Solve eta = phi(W eta + c) by Peaceman-Rachford splitting, which converges for every W with a multiplier T."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .activations import Activation
from .activations.base import Pieces
from .activations.stack import Units, groups, slopes
from .arrays import Array
from .brief import Brief
from .errors import NotWellPosedError

STEP_SIZES = 9  # tried between 1/L_F and 1/m
ROOT_STEPS = 200  # bisection alone needs about 60


@dataclass(frozen=True, eq=False)
class Splitting(Brief):
    """The operators of one W, ready for any number of c, and the factor by which an iteration contracts.

    With phi(z) = Lz + psi(z), A = I - LW, G = S - L and v = psi(z), the fixed point solves 0 in F v - g + df(v), where
    F = I - G W A^{-1}, g = G (I - WL)^{-1} c, and psi(z) = (I + df)^{-1}(G z) with f separable and convex; then
    eta = A^{-1}(v + Lc). In the inner product x'Ty, F is strongly monotone with m > 0 and Lipschitz with M, and df is
    maximal monotone. One iteration is w -> R(J(w)), the reflected resolvents of both parts for a step size alpha:

        J(w) = 2 (I + alpha F)^{-1} (w + alpha g) - w,   R(r) = 2 (I + alpha df)^{-1}(r) - r.

    R does not expand and J contracts by rate = ||(I - alpha F)(I + alpha F)^{-1}||_T, so |w_k - w*|_T falls at least as
    rate^k. The ratio |(I - alpha F)x|^2 / |(I + alpha F)x|^2 falls with <Fx, x> >= m |x|^2 and grows with |Fx| <= M |x|, so
    at alpha = 1/M the rate is at most sqrt((M - m) / (M + m)) < 1. A better alpha is chosen by its rate: for an F that is
    symmetric in the T-product, alpha = 1/sqrt(mM) gives (sqrt(M) - sqrt(m)) / (sqrt(M) + sqrt(m)).

    alpha, rate: as above; bound: sqrt((M - m) / (M + m)); F, inverse = (I + alpha F)^{-1}, drive = G (I - WL)^{-1} and
    back = A^{-1}: (q, q); low: L (q,); units: the q activations.
    """

    alpha: float
    rate: float
    bound: float
    F: Array
    inverse: Array
    drive: Array
    back: Array
    low: Array
    units: Units

    def begin(self, eta: Array, c: Array, W: Array) -> Array:
        """Return the w to start from (q, N) for a guess of eta (q, N): it is the limit if eta is the solution."""
        v = eta - self.low[:, None] * (W @ eta + c)
        return v + self.alpha * (self.F @ v - self.drive @ c)

    def iterate(self, w: Array, c: Array, steps: int) -> tuple[Array, Array]:
        """Return w and eta (q, N) after some iterations from w for columns c (q, N)."""
        shift, v = self.alpha * (self.drive @ c), w
        for _ in range(steps):
            reflected = 2.0 * (self.inverse @ (w + shift)) - w
            v = resolvent(self.units, self.alpha, reflected)
            w = 2.0 * v - reflected
        return w, self.back @ (v + self.low[:, None] * c)


def prepare(W: Array, units: Units, T: Array, alpha: float | None = None) -> Splitting:
    """Return the splitting of W (q, q) in the metric of T (q,), a multiplier of `monotone.condition`.

    alpha: the step size; chosen by its rate when left out. For alpha = 1 the resolvent of df is psi itself.
    Raises NotWellPosedError when F is not strongly monotone in that metric: T is no multiplier.

    >>> from inc_casadi.activations import ReLU
    >>> splitting = prepare(np.diag([-3.0, 0.0]), (ReLU(),) * 2, np.ones(2))  # F = diag(4, 1)
    >>> round(splitting.alpha, 9), round(splitting.rate, 9), round(splitting.bound, 9)
    (0.5, 0.333333333, 0.774596669)
    >>> splitting.iterate(np.zeros((2, 1)), np.array([[4.0], [-1.0]]), 40)[1].round(9).tolist()
    [[1.0], [0.0]]
    """
    (low, high), eye, root = slopes(units), np.eye(len(units)), np.sqrt(T)
    back = np.linalg.inv(eye - low[:, None] * W)
    F = eye - (high - low)[:, None] * (W @ back)
    scaled = root[:, None] * F / root[None, :]
    m, M = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0]), float(np.linalg.norm(scaled, 2))
    if not m > 0:
        raise NotWellPosedError(f"T is no multiplier of W ({len(units)} x {len(units)}): the monotonicity is {m:.3g}, "
                                "and must be positive")
    sizes = np.geomspace(1.0 / M, 1.0 / m, STEP_SIZES) if alpha is None else np.array([alpha])
    rates = [float(np.linalg.norm(2.0 * np.linalg.inv(eye + size * scaled) - eye, 2)) for size in sizes]
    alpha, rate = float(sizes[int(np.argmin(rates))]), min(rates)
    drive = (high - low)[:, None] * np.linalg.inv(eye - W * low[None, :])
    return Splitting(alpha, rate, float(np.sqrt((M - m) / (M + m))) if M > m else 0.0, F,
                     np.linalg.inv(eye + alpha * F), drive, back, low, units)


def resolvent(units: Units, alpha: float, r: Array) -> Array:
    """Return (I + alpha df)^{-1}(r) for columns r (q, N): psi(z) where (1 - alpha) psi(z) + alpha g z = r.

    Here psi(z) = phi(z) - l z has slopes within [0, g], g = s - l, and df(psi(z)) contains g z - psi(z). The left-hand
    side h(z) rises with a slope between min(1, alpha) g and max(1, alpha) g, so z is unique: found piece by piece when phi
    is piecewise affine, else by Newton steps within a bracket. A unit with g = 0 has a constant psi.

    >>> from inc_casadi.activations import ReLU, Saturation, Tanh
    >>> resolvent((ReLU(), Saturation()), 0.5, np.array([[2.0, -2.0], [0.5, 4.0]])).tolist()
    [[2.0, 0.0], [0.5, 1.0]]
    >>> x = resolvent((Tanh(),), 3.0, np.array([[2.0]]))
    >>> bool(abs(-2.0 * x + 3.0 * np.arctanh(x) - 2.0) < 1e-12)
    True
    """
    out = np.empty_like(r)
    for unit, rows in groups(units):
        low, high = unit.slopes
        if high == low:
            out[rows] = unit(np.zeros(1))[0]
        elif unit.pieces is not None:
            out[rows] = _by_pieces(unit.pieces, low, high - low, alpha, r[rows])
        else:
            z = _root(unit, alpha, r[rows])
            out[rows] = unit(z) - low * z
    return out


def _by_pieces(pieces: Pieces, low: float, gain: float, alpha: float, r: Array) -> Array:
    """psi(z) where h(z) = r, h being affine on each piece and rising."""
    psi = pieces.slopes - low
    steep, offset = (1.0 - alpha) * psi + alpha * gain, (1.0 - alpha) * pieces.intercepts
    which = np.searchsorted(steep[:-1] * pieces.kinks + offset[:-1], r, side="right")
    return psi[which] * ((r - offset[which]) / steep[which]) + pieces.intercepts[which]


def _root(unit: Activation, alpha: float, r: Array) -> Array:
    """The z with h(z) = r: Newton's step where it stays in the bracket and halves the step before, else the middle."""
    low, high = unit.slopes
    gain = high - low

    def h(z: Array) -> Array:
        return (1.0 - alpha) * (unit(z) - low * z) + alpha * gain * z - r

    gap = h(np.zeros_like(r))
    ends = (-gap / (min(1.0, alpha) * gain), -gap / (max(1.0, alpha) * gain))
    left, right = np.minimum(*ends), np.maximum(*ends)
    z, last = (left + right) / 2, right - left
    for _ in range(ROOT_STEPS):
        gap = h(z)
        left, right = np.where(gap <= 0, z, left), np.where(gap >= 0, z, right)
        new = z - gap / ((1.0 - alpha) * (unit.derivative(z) - low) + alpha * gain)
        good = (new >= left) & (new <= right) & (np.abs(new - z) <= 0.5 * last)
        new = np.where(good, new, (left + right) / 2)
        last, z = np.abs(new - z), new
        if np.all(last <= 1e-16 * np.maximum(1.0, np.abs(z))):
            break
    return z
