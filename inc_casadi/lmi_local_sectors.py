"""The search behind `local.sectors`: which bounds on the hidden units lead to the largest ellipsoid?"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .affine import Affine, index_of
from .arrays import Array
from .interior_point import solve
from .lmi_local_program import Around, Program, program_for
from .lmi_local_start import consistent_bounds, linear_start
from .lmi_problem import Problem
from .local.base import Setting
from .local.checks import is_satisfied
from .local.dead_zone import sector_between
from .local.lines import lines
from .local.sectors import LocalSectors
from .local.unit_bounds import linearized, local_lines
from .multipliers.base import Unknown

STEPS = (1.3, 1.12, 1.04, 1.012)  # factors by which bounds are widened or narrowed, the next when one gains nothing
GAIN = 2e-3  # of the merit's size, below which a step counts as none
FAR = 0.7  # behind the other mode, in the merit's size, from where a mode is given up
HALVINGS = 24
ROUGH, FINE = 1e-4, 1e-7  # relative gaps of the programs along the way, and of the last one
COST_DEPTH = 0.1  # of the way to an interior point, for the cost bound
DEEP = (0.02, 0.3, 1.0)  # of the way to an interior point, until the conditions hold with rounding bounded


@dataclass(frozen=True, eq=False)
class Found:
    """An ellipsoid with its numbers. values: those of `LocalSectors` without a cost; deep: the same, further inside."""

    program: Program
    merit: float
    values: dict[str, Array]
    deep: dict[str, Array]


def largest(setting: Setting, programs: int = 60) -> dict[str, Array] | str:
    """Return the values of the best ellipsoid that pass the conditions, or the reason why there are none.

    Given the bounds r and which units are bent, the largest ellipsoid is a convex program (`lmi_local_program`). The bounds
    are those that the present ellipsoid, widened by a factor, asks for: a wider range means wider sectors, so the factor
    is lowered when it gains nothing. The start is a Lyapunov ellipsoid of the linearized loop, halved until it works. Two
    modes are tried: bent lines for the kinked units that no other unit reads, and sectors for all units.

    programs: the most that each mode may solve after it has a first ellipsoid.

    >>> from inc_casadi import INC, Plant, Tanh, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.2]], [[1.0]]), INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()))
    >>> values = largest(Setting(loop, Attraction(), rest_of(loop)))
    >>> 9.8 < 2 / values["P"].item() ** 0.5 < 9.999  # x+ = 1.2 x - tanh x has its other equilibria at +-4.9995
    True
    """
    start = linear_start(setting)
    if start is None:
        return "the loop's linearization at the equilibrium is not stable"
    found: list[Found] = []
    for bent in modes(setting):
        rival = max((run.merit for run in found), default=-np.inf)
        run = grown(setting, start, bent, programs, rival=rival)
        found += [] if run is None else [run]
    if not found:
        return "no bounds on the hidden units were found for which the inequalities have a solution"
    for run in sorted(found, key=lambda run: -run.merit):
        values = _settled(setting, run)
        if not isinstance(values, str):
            return values
    return values


def modes(setting: Setting) -> list[np.ndarray]:
    """Return which units are bent, (q,) truths, mode by mode: those that no other unit reads, and none."""
    bendable = np.zeros(setting.loop.q, dtype=bool)
    bendable[lines(setting).bent] = True
    unread = ~np.any(setting.loop.inc.W != 0, axis=0)
    plain = [np.zeros_like(bendable)]
    return [bendable & unread, *plain] if np.any(bendable & unread) else plain


def grown(setting: Setting, start: Array, bent: np.ndarray, programs: int, *, rival: float = -np.inf,
          enough: float = np.inf, until: float = np.inf) -> Found | None:
    """Return the best ellipsoid of one mode, or None: a first one, then moves as long as they gain, smaller in each round.

    rival: the merit of another mode's; when the first move leaves this one far behind, no other is made. enough: the merit
    that ends the search; until: the time.monotonic() that does.
    """
    best, P, everywhere = None, start, np.ones(setting.loop.q)
    for _ in range(HALVINGS):
        best = _attempt(setting, P, everywhere, bent)
        if best is not None or time.monotonic() > until:
            break
        P = 4.0 * P
    left = programs
    if best is None:
        return None
    for step in STEPS:
        for move in _moves(setting, step, bent):
            if best.merit < rival - FAR * _size(setting, rival) and left < programs:
                return best
            while left > 0 and best.merit < enough and time.monotonic() <= until:
                left -= 1
                trial = _attempt(setting, best.values["P"], move, bent)
                if trial is None or trial.merit <= best.merit + GAIN * _size(setting, best.merit):
                    break
                best = trial
    return best


def _moves(setting: Setting, step: float, bent: np.ndarray) -> list[Array]:
    """Return factors (q,) for the bounds: all of them wider; above the finest step, those of one layer wider or narrower."""
    layer, q = _layers(setting.loop.inc.W), setting.loop.q
    found = [np.full(q, step)]
    kinds = [layer == k for k in np.unique(layer[~bent])]
    if len(kinds) > 1 and step > STEPS[-1]:
        found += [np.where(kind, factor, 1.0) for kind in kinds[::-1] for factor in (1 / step, step)]
    return found


def _layers(W: Array) -> np.ndarray:
    """Return the length of the longest path through W into each unit, cut off at q where W feeds back."""
    layer = np.zeros(len(W), dtype=int)
    for _ in range(len(W)):
        deeper = np.max(np.where(W != 0, layer + 1, 0), axis=1, initial=0)
        if np.array_equal(deeper, layer):
            return layer
        layer = deeper
    return np.zeros(len(W), dtype=int)


def _size(setting: Setting, merit: float) -> float:
    """Return what a relative gain refers to: a scale is taken relatively, the logarithm of a volume as it is."""
    return 1.0 if setting.claim.directions is None else abs(merit)


def _attempt(setting: Setting, P: Array, factor: Array, bent: np.ndarray) -> Found | None:
    """Return the largest ellipsoid under the bounds that {e'Pe <= 1} asks for times the factors (q,), or None."""
    found = around_at(setting, P, factor, bent)
    return None if found is None else _solved(setting, program_for(setting, found[0], P), found[1], ROUGH)


def around_at(setting: Setting, P: Array, factor: Array, bent: np.ndarray) -> tuple[Around, Array] | None:
    """Return what holds of the units under the bounds r that {e'Pe <= 1} asks for times the factors (q,), and r, or None."""
    r = consistent_bounds(setting, P, factor, ~bent)
    if r is None:
        return None
    bounds = linearized(setting, r, P)
    rooms = bounds.rooms(r)
    if np.any(rooms[r > 0] <= 0):
        return None
    H = np.where(bent[:, None], np.ones((1, setting.loop.n)), 0.0)
    return Around.of(local_lines(setting, r, H), bounds.rows(setting.loop.Z[:, : setting.loop.n]), rooms, r > 0), r


def _solved(setting: Setting, program: Program, r: Array, tolerance: float) -> Found | None:
    answer = solve(program.problem, tolerance=tolerance)
    if answer.interior is None or answer.status == "infeasible":
        return None
    values, deep = ({**program.values_at(y), "r": r} for y in (answer.y, answer.interior))
    return Found(program, setting.claim.merit(values["P"]), values, deep)


def _settled(setting: Setting, run: Found) -> dict[str, Array] | str:
    """Return the run's numbers, as far inside as it takes for the rounded conditions to hold, and P_cost if one is asked."""
    run = _solved(setting, run.program, run.values["r"], FINE) or run
    method = LocalSectors()
    reason = "the solver's numbers do not satisfy the inequalities they were found for"
    for share in DEEP:
        values = {name: (1 - share) * run.values[name] + share * run.deep[name] for name in run.values}
        if setting.claim.has_cost:
            cost = cheapest(setting, values, np.linalg.inv(values["P"]))
            if cost is None:
                reason = "no cost bound was found on the ellipsoid"
                continue
            values |= cost
        if is_satisfied(method, setting, values):
            return values
    return reason


def cheapest(setting: Setting, values: dict[str, Array], moment: Array) -> dict[str, Array] | None:
    """Return P_cost and Lambda_cost with the least tr(P_cost moment), strictly inside, or None.

    values: those of `LocalSectors` without a cost; moment (n, n) positive definite: E[e e'] of the states that count, which
    P^-1 is, up to a factor, for the uniform distribution on the ellipsoid.
    """
    loop, claim, n, q = setting.loop, setting.claim, setting.loop.n, setting.loop.q
    places, size = index_of([Unknown("P_cost", (n, n), "symmetric"), Unknown("Lambda_cost", (q,), "nonnegative")])
    P, weights = Affine.unknown(places["P_cost"]), Affine.unknown(places["Lambda_cost"])
    sector = sector_between(setting, local_lines(setting, values["r"], values["H"]), values["H"], weights)
    stage = loop.X.T @ claim.Q @ loop.X + loop.G.T @ claim.R @ loop.G
    drop = loop.X.T @ P @ loop.X - claim.discount * (loop.F.T @ P @ loop.F) - stage - sector
    mean = np.linalg.inv(values["P"])
    root = np.eye(n + q)
    root[:n, :n] = np.linalg.cholesky(mean)
    cost = np.bincount(places["P_cost"].ravel(), moment.ravel(), minlength=size)
    lower = np.full(size, -np.inf)
    lower[places["Lambda_cost"]] = 0.0
    blocks = (P.block(root[:n, :n]), drop.block(root))
    answer = solve(Problem(cost, blocks, np.zeros((0, size)), np.zeros(0), lower, np.full(size, np.inf)), tolerance=FINE)
    if answer.interior is None:
        return None
    y = (1 - COST_DEPTH) * answer.y + COST_DEPTH * answer.interior
    return {name: y[place] for name, place in places.items()}
