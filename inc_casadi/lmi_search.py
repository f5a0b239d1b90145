"""Search for the numbers of a certificate, by an interior-point method of our own and by Clarabel where that gives up.

A solver's status is history, never a verdict: whatever numbers come back are judged by `MatrixCertificate`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from .arrays import Array
from .certificate import MatrixCertificate
from .certificate_values import posed_values
from .claims.base import Claim
from .errors import SolverError
from .inc import INC
from .inequalities import Inequalities
from .lmi_assembly import Assembly, assembled
from .lmi_problem import Solution
from .lmi_solvers import Solvers
from .loop import ClosedLoop, close_loop
from .multipliers import Multiplier
from .plant import Plant

SLACKS = (1e-7, 1e-6, 1e-5, 1e-4)
INWARD = (1e-6, 1e-4, 1e-2, 0.3, 1.0)
EXACT_UP_TO = 24
RATE_TOLERANCE = 1e-4
SLOWEST = 1e-9  # level, relative to its ceiling, below which none is named
BACK_OFF = (1.0, 1.0 - 1e-6, 1.0 - 1e-5, 1.0 - 1e-4, 0.99, 0.9)  # of a step that plain eigenvalues allow
CLOSE = 1e-3  # a relative margin that other coordinates may still mend


def _require_scipy() -> None:
    try:
        import scipy.linalg  # noqa: F401
    except ImportError as error:
        raise SolverError("searching for a certificate needs SciPy: pip install scipy") from error


def search(plant: Plant, inc: INC, claim: Claim, multiplier: Multiplier, *, solver: str = "auto",
           start: MatrixCertificate | None = None) -> MatrixCertificate:
    """Return the certificate with the best numbers found; it may not hold.

    Minimizes the claim's objective, in coordinates where the loop is of size one. Numbers that rounding spoils are moved
    towards a deeper point of the same problem until they survive the check. Without an objective, or when nothing
    survives, the smallest eigenvalue is maximized instead, which ends with the least violated numbers. A claim with an
    open level (`Stability` without a rate) gets the best that is found.

    solver: "interior point" (NumPy and LAPACK), "clarabel", or "auto", the former with the latter for what it gives up on.
    start: a certificate of a nearby loop, claim or level: the search works in the coordinates in which its P is the
    identity. (A warm start of the interior-point method itself was measured and takes as many iterations as a cold one.)

    Raises SolverError when SciPy is missing, or Clarabel when it is asked for.

    >>> from inc_casadi.claims import Stability
    >>> from inc_casadi.multipliers import Sector
    >>> found = search(Plant([[0.5]], [[1.0]]), INC.linear([[0.0]]), Stability(0.6), Sector())
    >>> found.holds()
    True
    """
    how, loop = Solvers(solver), close_loop(plant, inc)
    _require_scipy()
    if claim.tunable:
        return _best_level(loop, claim, multiplier, how)
    programs = assembled(loop, claim, multiplier)
    if start is not None:
        programs = replace(programs, frame=programs.frame.refined(start.values, loop))
    found: list[MatrixCertificate] = []
    if programs.minimizes:
        found, best = _minimized(programs, how)
        if best is not None:
            return best
    found += _widest(programs, how)
    if programs.minimizes and found and survives(found[-1]):
        refined = replace(programs, frame=programs.frame.refined(found[-1].values, loop))
        proved = [found[-1], *filter(None, [_minimized(refined, how)[1]])]
        return max(proved, key=lambda certificate: claim.merit(loop, certificate.values))
    if not found:
        return unsolved(plant, inc, claim, multiplier, "the solver returned no numbers")
    return max(found, key=worst_margin)


def _certificate(programs: Assembly, y: Array) -> MatrixCertificate:
    parts = programs.inequalities
    values = programs.values_at(y) | posed_values(parts.loop.inc)
    return MatrixCertificate(parts.loop.plant, parts.loop.inc, parts.claim, parts.multiplier, values)


def _minimized(programs: Assembly, how: Solvers) -> tuple[list[MatrixCertificate], MatrixCertificate | None]:
    """Return what minimizing gives, moved inward, or asked for with more and more slack, and the first that survives."""
    found = []
    slacks = (0.0, *SLACKS) if how.ends_inside(programs.cheapest()) else SLACKS
    for slack in slacks:
        solution = how.solve(programs.cheapest(slack))
        if solution.status == "infeasible" or not np.all(np.isfinite(solution.y)):
            break
        for y in _inward(solution):
            found.append(_certificate(programs, y))
            if survives(found[-1]):
                return found, found[-1]
    return found, None


def _inward(solution: Solution) -> Iterator[Array]:
    """Yield the point, then points further and further along the way to the deeper one."""
    yield solution.y
    if solution.interior is not None:
        for part in INWARD:
            yield solution.y + part * (solution.interior - solution.y)


def _widest(programs: Assembly, how: Solvers) -> list[MatrixCertificate]:
    """Return what maximizing the smallest eigenvalue gives; once more in better coordinates when it is close."""
    found: list[MatrixCertificate] = []
    for _ in range(2):
        y = how.solve(programs.widest()).y[:-1]
        if not np.all(np.isfinite(y)):
            break
        found.append(_certificate(programs, y))
        if not -CLOSE < worst_margin(found[-1]) <= 0:
            break
        programs = replace(programs, frame=programs.frame.refined(found[-1].values, programs.inequalities.loop))
    return found


def survives(certificate: MatrixCertificate) -> bool:
    """Return whether every condition is proved: in floats, or exactly where that is quick."""
    return certificate.surely(EXACT_UP_TO)


def worst_margin(certificate: MatrixCertificate) -> float:
    """Return the smallest margin of a certificate, sign conditions counted only when they fail."""
    margins = certificate.margins()
    return min(value for name, value in margins.items() if not (name.endswith(">= 0") and value >= 0))


def unsolved(plant: Plant, inc: INC, claim: Claim, multiplier: Multiplier, note: str) -> MatrixCertificate:
    """Return a certificate of zeros, which never holds, for a loop on which no search makes sense."""
    zeros = Inequalities(close_loop(plant, inc), claim, multiplier).zeros() | posed_values(inc)
    return MatrixCertificate(plant, inc, claim, multiplier, zeros, note)


def _best_level(loop: ClosedLoop, claim: Claim, multiplier: Multiplier, how: Solvers) -> MatrixCertificate:
    """Return a certificate at the best level, within a relative `RATE_TOLERANCE`.

    Each solve either fails, which lowers the ceiling, or gives numbers that are pushed as far as they prove. Bold steps
    bisect; cautious ones ask for a little more than what is proved, which converges fast and ends the search.
    """
    programs = assembled(loop, claim, multiplier)
    start = max(_widest(programs, how), key=worst_margin, default=None)
    if start is None or not survives(start):
        return start or unsolved(loop.plant, loop.inc, claim, multiplier, "the solver returned no numbers")
    frame = programs.frame
    ceiling = min(claim.ceiling(loop), 8.0 * float(np.linalg.norm(frame.T @ loop.F @ frame.congruence(loop), 2)) + 2.0)
    level, best = _pushed(start, claim, 0.0, ceiling)
    if level == 0.0:
        return start
    bold = True
    while ceiling - level > RATE_TOLERANCE * level:
        middle = np.sqrt(level * ceiling) if ceiling > 4 * level else (level + ceiling) / 2
        trial = float(middle if bold else min(middle, level * (1 + 0.9 * RATE_TOLERANCE)))
        bold = not bold
        asked = Assembly(Inequalities(loop, claim.at(trial, loop), multiplier), frame.refined(best.values, loop))
        y = how.solve(asked.widest(), tolerance=float(np.clip(1e-3 * trial, 1e-8, 1e-5))).y[:-1]
        found = _certificate(asked, y) if np.all(np.isfinite(y)) else None
        if found is None or not survives(found):
            ceiling = trial
        else:
            level, best = _pushed(found, claim, trial, ceiling)
    return best


def _pushed(found: MatrixCertificate, claim: Claim, level: float, ceiling: float) -> tuple[float, MatrixCertificate]:
    """Return a level near the strongest one below the ceiling that the numbers of a certificate prove.

    Plain eigenvalues find it, and one rigorous check, or a few with a little less, settle it.
    """
    numbers = _Fixed.of(found, claim)
    strongest, step = level, ceiling
    while step > max(SLOWEST * ceiling, 0.1 * RATE_TOLERANCE * strongest):
        step /= 2.0
        if strongest + step < ceiling and numbers.hold_at(strongest + step):
            strongest += step
    for part in BACK_OFF:
        trial = level + part * (strongest - level)
        if trial > level:
            stronger = replace(found, claim=claim.at(trial, found.loop))
            if survives(stronger):
                return trial, stronger
    return level, found


@dataclass(frozen=True, eq=False)
class _Fixed:
    """The numbers of a certificate, to be tried at several levels of its claim."""

    claim: Claim
    inequalities: Inequalities
    values: Mapping[str, Array]
    M: Mapping[str, Array]

    @classmethod
    def of(cls, found: MatrixCertificate, claim: Claim) -> _Fixed:
        parts = found.inequalities
        return cls(claim, parts, found.values, parts.multiplier_matrices(found.values))

    def hold_at(self, level: float) -> bool:
        """Whether every condition is positive definite to plain floating point."""
        claim = self.claim.at(level, self.inequalities.loop)
        conditions = claim.conditions(self.inequalities.graphs, self.values, self.M)
        return all(_is_positive(condition) for condition in conditions.values())


def _is_positive(condition: Array) -> bool:
    diagonal = np.diag(condition)
    if not np.all(diagonal > 0):
        return False
    scale = 1.0 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(condition * np.outer(scale, scale))[0] > 1e-13)
