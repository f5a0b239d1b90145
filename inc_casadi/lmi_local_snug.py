"""The search behind `ellipsoidal_region`: of the ellipsoids that contain the initial states, one with a low cost bound."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from .arrays import Array
from .interior_point import solve
from .lmi_local_cost import INSIDE, program_for_cost
from .lmi_local_program import Around, Program
from .lmi_local_sectors import DEEP, FINE, around_at, cheapest, grown, modes
from .lmi_local_start import linear_start
from .local.base import Setting, without_cost
from .local.checks import is_satisfied
from .local.containment import Hull, largest, outermost
from .local.sectors import LocalSectors
from .sets import Ellipsoid

NOT_STABLE = "the loop's linearization at the equilibrium is not stable"
LATE = "the time limit ended the search"
REACHES = "the largest ellipsoid found contains the initial set scaled by"
NO_COST = "no bound on the cost was found on an ellipsoid that contains the initial set"
ENOUGH = 1.2  # reach at which an ellipsoid is wide enough to begin lowering its cost
ROUNDS = 4  # in which deviations that were not contained are added to those that are asked for
PROGRAMS = 60
MOST_UNITS = 24  # up to which bent lines are tried where sectors do
SNUG = 3  # programs that lower the cost, at most
LOWER = 2e-3  # share by which each is to lower it
LOOSE = 1.001  # factor on the bounds of hidden units, so that the present ellipsoid lies strictly within them
SHARES = (1e-3, *DEEP)  # of the way to an interior point


@dataclass(frozen=True, eq=False)
class Snug:
    """Values of `LocalSectors` with P_cost, and what they bound the expected form by, tr(P_cost moment)."""

    values: dict[str, Array]
    cost: float


def snug(setting: Setting, hull: Hull, moment: Array, until: float = np.inf) -> dict[str, Array] | str:
    """Return values of `LocalSectors` for an ellipsoid that contains the initial states, or why there are none.

    First any such ellipsoid (`lmi_local_sectors.grown`, along deviations that are hard to contain), then smaller ones: as
    an ellipsoid shrinks onto the initial states its units move less, their sectors narrow and the cost bound falls. Each
    step is one convex program in X = P^-1 (`lmi_local_cost`); P_cost is then the least under the sectors found.

    setting: its claim asks for a cost; hull: of the initial states; moment (n, n): E[e e'], e counted from rest; until: the
    time.monotonic() at which to end, with the best found by then.

    >>> from inc_casadi import INC, Plant, Tanh, close_loop
    >>> from inc_casadi.claims.attraction import Attraction
    >>> from inc_casadi.local.rest import rest_of
    >>> loop = close_loop(Plant([[1.2]], [[1.0]]), INC([[0.0]], [[1.0]], [[-1.0]], [[0.0]], activation=Tanh()))
    >>> setting = Setting(loop, Attraction(Q=[[1.0]], R=[[0.0]]), rest_of(loop))
    >>> near, far = (snug(setting, np.array([[s]]), np.array([[s**2]])) for s in (0.1, 2.0))
    >>> bool(near["P_cost"].item() < 1.06 < 1.5 < far["P_cost"].item())  # 1 / (1 - 0.2^2) = 1.042 for small motions
    True
    """
    plain = without_cost(setting)
    start = linear_start(plain)
    if start is None:
        return NOT_STABLE
    if time.monotonic() > until:
        return f"{LATE} before it began"
    found: list[Snug] = []
    reach = 0.0
    start = start * max(1.0, 1.0 / largest(hull, start, setting.rest.center)[0])  # no wider than need be
    for bent in reversed(modes(plain)):  # sectors first: where they reach, they mostly cost less
        if found and (setting.loop.q > MOST_UNITS or time.monotonic() > until):
            break
        wide = _reaching(plain, hull, start, bent, until)
        reach = max(reach, 0.0 if wide is None else wide[1])
        if wide is not None and wide[1] >= 1:
            found += _lowered(setting, hull, moment, bent, wide[0] * wide[1] ** 2 * (1 - INSIDE), until)
    if found:
        return min(found, key=lambda one: one.cost).values
    late = f", and {LATE}" if time.monotonic() > until else ""
    if reach >= 1:
        return NO_COST + late
    return f"{REACHES} {reach:.4g} about the equilibrium only{late}"


def _reaching(setting: Setting, hull: Hull, start: Array, bent: np.ndarray, until: float) -> tuple[Array, float] | None:
    """Return P of an ellipsoid that is wide towards the initial states, and the scale of them that it contains, or None."""
    center, P, asked, best = setting.rest.center, start, np.zeros((setting.loop.n, 0)), None
    for _ in range(ROUNDS):
        asked = np.unique(np.hstack([asked, outermost(hull, P, center)]), axis=1)
        aimed = replace(setting, claim=replace(setting.claim, shape="reach", directions=asked))
        run = grown(aimed, start, bent, PROGRAMS, enough=ENOUGH, until=until)
        if run is None:
            break
        P = run.values["P"]
        reach = largest(hull, P, center)[0] ** -0.5
        best = (P, reach) if best is None or reach > best[1] else best
        if reach >= 1 or run.merit < 1 or time.monotonic() > until:
            break
    return best


def _lowered(setting: Setting, hull: Hull, moment: Array, bent: np.ndarray, P: Array, until: float) -> list[Snug]:
    """Return the ellipsoid of least cost that a few programs lead to from P, as a list of one, or an empty one."""
    plain = without_cost(setting)
    best: list[Snug] = []
    for _ in range(SNUG):
        around = around_at(plain, P, np.full(setting.loop.q, LOOSE), bent)
        if around is None or best and time.monotonic() > until:
            break
        found = _cheaper(setting, hull, moment, around, P)
        if found is None or best and found.cost > best[0].cost * (1 - LOWER):
            return best if found is None or best[0].cost < found.cost else [found]
        best, P = [found], found.values["P"]
    return best


def _cheaper(setting: Setting, hull: Hull, moment: Array, around: tuple[Around, Array], P: Array) -> Snug | None:
    """Return what one program gives under given bounds on the units, repeated with the corners that it leaves out."""
    if isinstance(hull, Ellipsoid):
        found = _settled(setting, hull, moment, program_for_cost(setting, around[0], P, hull), around[1])
        return found if isinstance(found, Snug) else None
    asked: Array = outermost(hull, P, setting.rest.center)
    for _ in range(ROUNDS):
        found = _settled(setting, hull, moment, program_for_cost(setting, around[0], P, asked), around[1])
        if not isinstance(found, np.ndarray):
            return found
        asked = np.unique(np.hstack([asked, found]), axis=1)
    return None


def _settled(setting: Setting, hull: Hull, moment: Array, program: Program, r: Array) -> Snug | Array | None:
    """Return the program's numbers, as far inside as it takes for all conditions to hold with rounding bounded, or None.

    Where the program did not ask for corners that its ellipsoid leaves out, these are returned.
    """
    answer, center = solve(program.problem, tolerance=FINE), setting.rest.center
    if answer.interior is None or answer.status == "infeasible":
        return None
    top, deep = ({**program.values_at(y), "r": r} for y in (answer.y, answer.interior))
    if not isinstance(hull, Ellipsoid) and largest(hull, top["P"], center)[0] > 1:
        return outermost(hull, top["P"], center)
    for share in SHARES:
        values = {name: (1 - share) * top[name] + share * deep[name] for name in top}
        if largest(hull, values["P"], center)[0] > 1:
            continue
        weight = moment + 1e-6 * np.sum(moment * values["P"]) / setting.loop.n * np.linalg.inv(values["P"])
        cost = cheapest(setting, values, weight)
        if cost is not None and is_satisfied(LocalSectors(), setting, values | cost):
            return Snug(values | cost, float(np.sum(cost["P_cost"] * moment)))
    return None
