"""The ellipsoid around the equilibrium where the loop is affine for ever after, and the cost from there on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..arrays import Array
from ..brief import Brief
from ..claims.regional import Regional
from ..errors import ConvergenceError, NoEquilibriumError
from ..loop import equilibrium
from .fixed import rounded
from .laws import Laws, PiecewiseLoop
from .linear import discounted_lyapunov, identity, positive_definite, solve

LEVEL_SHRINK = 1 - 1e-9
TAIL_SLACK = 1e-10
TAIL_SHARES = (1e-14, 1e-13, 1e-12)
CONSTANT_SLACK = 1e-12
TRANSIENT = 1e-3  # of a bound's distance, relative to the bound that is used most


@dataclass(frozen=True, eq=False)
class TerminalSet(Brief):
    """The ellipsoid E = {x: e'P e <= level}, e = x - x*, from which every motion converges to x*, and the cost from there.

    pattern (q,): the pattern at x*; x (n,): the equilibrium x*; tail (n+1, n+1): the discounted cost from x in E is at
    most (e, 1)' tail (e, 1).

    Where x* is on no kink, the controller is one affine law on E, E is invariant, the tail is the cost up to rounding when
    `slack` is 0, and `excess` is None. Where it is on kinks (`conewise_tail`), the tail is an upper bound, too large by
    (e, 1)' excess (e, 1) at most.

    The former is sound when `refusal` finds nothing: (1) P > 0 and P - A*'P A* > 0, so E is invariant and every motion in it
    converges to x*; (2) each bound on z or u is at distance d > 0 from its value at x* and d^2 >= level w'P^{-1} w for
    its gradient w, so that no bound is crossed in E; (3) tail - M - discount A_h' tail A_h >= 0 with A_h = diag(A*, 1)
    and M the stage cost in (e, 1), so that summing along a motion gives the cost bound (thm:performance with no
    uncertainty).
    """

    pattern: np.ndarray
    x: Array
    P: Array
    level: Any
    tail: Array
    excess: Array | None = None

    def contains(self, points: Array) -> np.ndarray:
        """Which of the points (..., n) lie in the ellipsoid."""
        e = points - self.x
        return ((e @ self.P) * e).sum(axis=-1) <= self.level

    def overestimate(self, points: Array, scale: Array) -> float:
        """Return the largest scale (e, 1)' excess (e, 1) over points (N, n) in E, scale (N,); 0 without `excess`."""
        if self.excess is None:
            return 0.0
        lifted = np.concatenate([points - self.x, np.ones((len(points), 1))], axis=1)
        return float(np.max(scale * ((lifted @ self.excess) * lifted).sum(axis=1), initial=0.0))

    def tail_form(self, vertices: Array) -> Array:
        """Return the tail cost as a form (N, k, k) in the barycentric coordinates of vertices (N, k, n)."""
        e = vertices - self.x
        lifted = np.concatenate([e, e[..., :1] * 0 + 1], axis=-1)
        return lifted @ self.tail @ np.swapaxes(lifted, -1, -2)


def find(loop: PiecewiseLoop, claim: Regional) -> tuple[TerminalSet | None, str]:
    """Return a terminal set of the loop, or None and the reason why there is none.

    P solves A*'P A* - P = -(Q + K*'R K*) with a small multiple of the identity added, the level is the largest that
    keeps within the piece and the limits. Computed in floats; `refusal` decides.
    """
    around = _affine_loop(loop)
    if isinstance(around, str):
        return None, around
    pattern, law, x, A_star = around
    radius = float(np.max(np.abs(np.linalg.eigvals(A_star))))
    where = f"x* = {(np.round(x, 6) + 0.0).tolist()}"
    if radius >= 1:
        return None, f"the law around its equilibrium {where} does not stabilize: its spectral radius is {radius:.6g}"
    stage = claim.Q + law.Gx[0].T @ claim.R @ law.Gx[0]
    room = max(float(np.trace(stage)), 1.0 if not stage.any() else 0.0) / len(x)
    P = discounted_lyapunov(A_star, stage + 1e-2 * room * np.eye(len(x)))
    P = P / np.max(np.abs(P))
    distance, gradient, names = _bounds(loop, claim, law, x)
    reach = (gradient * np.linalg.solve(P, gradient.T).T).sum(axis=1)
    moving = reach > 0
    if np.any(distance[moving] <= 1e-9 * np.sqrt(reach[moving])):
        worst = np.flatnonzero(moving)[int(np.argmin(distance[moving] / np.sqrt(reach[moving])))]
        return None, f"the equilibrium {where} lies on or beyond {names[worst]}"
    level = LEVEL_SHRINK * float(np.min(distance[moving] ** 2 / reach[moving], initial=1e12))
    tail = _tail(claim, law.Gx[0], law.g[0], A_star, x, slack=0.0)
    if tail is None:
        return None, f"resting at {where} costs something at every step, and discount = 1"
    return TerminalSet(pattern, x, P, level, tail), ""


def widened(loop: PiecewiseLoop, claim: Regional, found: TerminalSet, late: Array) -> TerminalSet:
    """Return the set with another ellipsoid, wider where motions are late, if bounds that they no longer near held it back.

    late (N, n): states that motions have after a while. A bound, at distance d and with gradient w, is transient when these
    use up at most a thousandth of the share |w'e| / d of their distance that they use up of some other's: a gate that was
    open in the first steps, say. Let A*'S A* - S = -sum w w' / d^2 over the transient ones. With P + t S in place of P the
    level that they allow, d^2 / w'(P + t S)^{-1} w, is at least t; so with t twice what the others allow these decide, and
    late motions, to which S hardly adds anything, arrive sooner.
    """
    law = loop.laws(found.pattern[None])
    A_star = loop.plant.A + loop.plant.B @ law.Gx[0]
    distance, gradient, _ = _bounds(loop, claim, law, found.x)
    if not len(late) or not np.all(np.isfinite(late)) or not distance.size:
        return found
    used = np.max(np.abs((late - found.x) @ gradient.T), axis=0) / distance
    transient = used <= TRANSIENT * np.max(used)
    if not transient.any() or transient.all():
        return found
    scaled = gradient[transient] / distance[transient, None]
    S = discounted_lyapunov(A_star, scaled.T @ scaled)
    P = found.P + 2.0 * _widest(found.P, distance[~transient], gradient[~transient]) * (S + S.T) / 2
    size = float(np.max(np.abs(P)))
    return replace(found, P=P / size, level=LEVEL_SHRINK * _widest(P / size, distance, gradient))


def _widest(P: Array, distance: Array, gradient: Array) -> float:
    """The largest level whose ellipsoid keeps within all bounds, 1e12 at most."""
    reach = (gradient * np.linalg.solve(P, gradient.T).T).sum(axis=1)
    return float(np.min(distance[reach > 0] ** 2 / reach[reach > 0], initial=1e12))


def with_ellipsoid(loop: PiecewiseLoop, claim: Regional, P: Array, level: float) -> TerminalSet | None:
    """Return the terminal set with a given ellipsoid around the loop's equilibrium, in floats and not yet checked."""
    around = _affine_loop(loop)
    if isinstance(around, str):
        return None
    pattern, law, x, A_star = around
    if np.max(np.abs(np.linalg.eigvals(A_star))) >= 1:
        return None
    tail = _tail(claim, law.Gx[0], law.g[0], A_star, x, slack=0.0)
    return None if tail is None else TerminalSet(pattern, x, P, level, tail)


def _affine_loop(loop: PiecewiseLoop) -> tuple[np.ndarray, Laws, Array, Array] | str:
    """The pattern and law at the equilibrium, the equilibrium of that law and its closed-loop matrix, or a reason."""
    try:
        rest = equilibrium(loop.plant, loop.inc)
    except (NoEquilibriumError, ConvergenceError) as error:
        return str(error)
    pattern = loop.patterns_at(rest.x[None])
    law = loop.laws(pattern)
    A_star = loop.plant.A + loop.plant.B @ law.Gx[0]
    shift = identity(loop.plant.n, A_star) - A_star
    if np.linalg.cond(shift) > 1e14:
        return f"the equilibrium x* = {np.round(rest.x, 6).tolist()} is not isolated"
    return pattern[0], law, solve(shift, (loop.plant.B @ law.g[0])[:, None])[:, 0], A_star


def in_fractions(loop: PiecewiseLoop, claim: Regional, found: TerminalSet) -> TerminalSet:
    """Return the set in Fractions with the exact equilibrium and a tail bound that is strict by a small slack.

    The slack makes up for the rounding of the tail, and is part of every cost that is proved. So shares of the tail itself
    are tried first, the least that suffices, whatever the units of the states are. Where the tail is singular, as for a
    state of a controller that no longer matters, the same shares of its largest value on the ellipsoid are added in every
    direction, and at last a share of the stage cost's size.
    """
    law = loop.laws(found.pattern[None])
    A_star = loop.numbers(loop.plant.A) + loop.numbers(loop.plant.B) @ law.Gx[0]
    rest = solve(identity(loop.plant.n, A_star) - A_star, (loop.numbers(loop.plant.B) @ law.g[0])[:, None])[:, 0]
    rounded_law = (law.Gx[0].astype(float), law.g[0].astype(float), A_star.astype(float), rest.astype(float))
    number, exact = loop.numbers, None
    spread = _spread(found)
    for share, more in (*((share, 0.0 * spread) for share in TAIL_SHARES), *((share, spread) for share in TAIL_SHARES),
                        (None, spread)):
        tail = _tail(claim, *rounded_law, slack=TAIL_SLACK if share is None else 0.0, share=share or 0.0, more=more)
        assert tail is not None
        exact = TerminalSet(found.pattern, rest, number(found.P), number(np.array(found.level)).item(), number(tail))
        if _tail_refusal(loop, claim, exact, law.Gx[0], law.g[0], A_star) is None:
            break
    assert exact is not None
    return exact


def in_places(exact: TerminalSet, share: float) -> TerminalSet:
    """Return a set given in Fractions with numbers of 256 binary places and its level lowered to a share of itself."""
    level = rounded(exact.level * Fraction(share)).item()
    return TerminalSet(exact.pattern, rounded(exact.x), rounded(exact.P), level, rounded(exact.tail))


def refusal(loop: PiecewiseLoop, claim: Regional, found: TerminalSet) -> str | None:
    """Return why the terminal set is not sound, or None; in Fractions when the loop's numbers are.

    In floats the conditions are checked beyond rounding, the tail only in Fractions, where it carries a slack.
    """
    number = loop.numbers
    law = loop.laws(found.pattern[None])
    A_star = number(loop.plant.A) + number(loop.plant.B) @ law.Gx[0]
    if not (positive_definite(found.P) and positive_definite(found.P - A_star.T @ found.P @ A_star)):
        return "the terminal ellipsoid is not invariant"
    distance, gradient, names = _bounds(loop, claim, law, found.x)
    reach = (gradient * solve(found.P, gradient.T).T).sum(axis=1)
    for name, space, need in zip(names, distance, found.level * reach, strict=True):
        if space < 0 or space * space < need:
            return f"the terminal ellipsoid crosses {name}"
    if loop.arithmetic == "exact":
        return _tail_refusal(loop, claim, found, law.Gx[0], law.g[0], A_star)
    return None


def _bounds(loop: PiecewiseLoop, claim: Regional, law: Laws, x: Array) -> tuple[Array, Array, list[str]]:
    """Distances at x* to every bound of the piece and every input limit, and the gradients of the bounded values."""
    number = loop.numbers
    z = law.Zx[0] @ x + law.z0[0]
    low = np.flatnonzero(np.isfinite(law.low[0].astype(float)))
    high = np.flatnonzero(np.isfinite(law.high[0].astype(float)))
    distance = [z[low] - number(law.low[0][low]), number(law.high[0][high]) - z[high]]
    gradient = [law.Zx[0][low], law.Zx[0][high]]
    names = [f"a kink of hidden unit {i}" for i in (*low, *high)]
    if claim.inputs is not None:
        H, h = number(claim.inputs.H), number(claim.inputs.h)
        distance.append(h - H @ (law.Gx[0] @ x + law.g[0]))
        gradient.append(H @ law.Gx[0])
        names += [f"input limit {i}" for i in range(len(h))]
    return np.concatenate(distance), np.concatenate(gradient), names


def _stage_form(claim: Regional, Gx: Array, g: Array, x: Array, number) -> Array:
    """The stage cost as a form in (e, 1)."""
    n = x.shape[0]
    Q, R = number(claim.Q), number(claim.R)
    u = Gx @ x + g
    cross = Q @ x + Gx.T @ (R @ u)
    form = np.zeros((n + 1, n + 1), dtype=Q.dtype)
    form[:n, :n], form[:n, n], form[n, :n] = Q + Gx.T @ R @ Gx, cross, cross
    form[n, n] = x @ Q @ x + u @ R @ u
    return form


def _spread(found: TerminalSet) -> Array:
    """The least multiple of P that is at least the quadratic part of the tail."""
    n = len(found.x)
    return np.asarray(found.P * float(np.max(np.linalg.eigvals(np.linalg.solve(found.P, found.tail[:n, :n])).real)))


def _tail(claim: Regional, Gx: Array, g: Array, A_star: Array, x: Array, slack: float, share: float = 0.0,
          more: Array | float = 0.0) -> Array | None:
    n, beta = x.shape[0], claim.discount
    form = _stage_form(claim, Gx, g, x, np.asarray)
    scale = float(np.trace(form[:n, :n])) / n
    tail = np.zeros((n + 1, n + 1))
    stage = form[:n, :n] + slack * scale * np.eye(n)
    tail[:n, :n] = discounted_lyapunov(A_star, stage, beta)
    if share:
        tail[:n, :n] = discounted_lyapunov(A_star, stage + share * (tail[:n, :n] + more), beta)
    if beta < 1:
        p = np.linalg.solve(np.eye(n) - beta * A_star.T, form[:n, n])
        tail[:n, n], tail[n, :n] = p, p
        tail[n, n] = form[n, n] * (1 + (CONSTANT_SLACK if slack or share else 0.0)) / (1 - beta)
    elif form[n, n] > 1e-20 * scale:
        return None
    return tail


def _tail_refusal(loop: PiecewiseLoop, claim: Regional, found: TerminalSet, Gx: Array, g: Array,
                  A_star: Array) -> str | None:
    n, beta = loop.plant.n, loop.numbers(np.array(claim.discount)).item()
    form = _stage_form(claim, Gx, g, found.x, loop.numbers)
    A_h = identity(n + 1, A_star)
    A_h[:n, :n] = A_star
    gap = found.tail - form - beta * (A_h.T @ found.tail @ A_h)
    if beta == 1 and np.any(form[n] != 0):
        return "resting at the exact equilibrium costs something at every step, and discount = 1"
    if beta == 1 or not gap[n].any():
        gap = gap[:n, :n]
    return None if not gap.any() or positive_definite(gap) else "the tail cost is not bounded by the stored matrix"
