"""Search for a terminal set around an equilibrium on kinks; whatever is found, `conewise_tail.refusal` judges."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..certificate import MatrixCertificate
from ..claims.performance import DiscountedCost
from ..claims.regional import Regional
from ..errors import SolverError
from ..inequalities import Inequalities
from ..lmi_search import search
from ..loop import close_loop
from ..multipliers import LADDER, Multiplier
from ..plant import Plant
from ..sets import Gaussian
from .conewise import ConewiseLaw, conewise_law, largest_level, rooms
from .conewise_tail import ConewiseProof, is_semidefinite
from .laws import PiecewiseLoop

MOST_UNKNOWNS = 1500  # up to which a multiplier is tried: about ten seconds for each search
FLOOR = 1e-2  # what M adds to Q, relative to the mean cost of a step, where Q is not well positive definite
SMALL = 1e-6  # Q counts as well positive definite from this smallest eigenvalue, relative to the largest
ROUNDED = 1e-12  # added to an R that is positive semidefinite up to rounding only


def find(loop: PiecewiseLoop, claim: Regional, built_in: bool) -> tuple[ConewiseProof, float] | str:
    """Return a proof with the largest level that it allows, no more than fits around the initial set, or a reason.

    First the rungs of multipliers are tried, the cheapest first, until one certifies that motions settle, with M = Q or a
    little more. Where that leaves the claim's cost bounded by much more than need be (M > Q, or a discount), the same rung
    minimizes a bound on it.

    built_in: whether the law cannot leave the input limits, so that the terminal set need not keep away from them.

    >>> from inc_casadi import INC, Box
    >>> loop = PiecewiseLoop(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[-0.5]], [[0.0]]))
    >>> proof, level = find(loop, Regional(Box([-1.0], [1.0]), None, [[1.0]], [[0.0]]), built_in=True)
    >>> proof.settling.holds(), proof.P.round(3).tolist()  # 4 / 3 on the left, 1 on the right
    (True, [[1.333]])
    """
    local = conewise_law(loop.plant, loop.inc)
    if isinstance(local, str):
        return local
    S = _moment(claim, local)
    settling = _settling(claim, S)
    try:
        found, notes = _first(loop.plant, local, settling)
        if found is None:
            units = ", ".join(map(str, local.on_kinks))
            return (f"hidden units {units} rest on kinks, and for the conewise linear loop around the equilibrium no "
                    f"certificate of stability was found ({'; '.join(notes)})")
        cost = None if settling.Q is claim.Q and claim.discount == 1.0 else _cost(loop.plant, local, claim, S, found)
    except SolverError as error:
        return f"hidden units rest on kinks, and the conewise linear loop around the equilibrium needs a search: {error}"
    proof = ConewiseProof(found, cost)
    level = largest_level(rooms(loop.plant, loop.inc, local, None if built_in else claim.inputs, proof.M))
    if level == 0:
        return "hidden units rest on kinks, and inputs so close to a limit that nothing around the equilibrium is certified"
    e = claim.initial.vertices.T - local.x.astype(float)
    return proof, min(level, float(((e @ proof.P) * e).sum(axis=1).max()))


def _moment(claim: Regional, local: ConewiseLaw) -> Array:
    """The second moment of x0 - x*: what bounds are minimized for, and the units that states are measured in."""
    away = claim.initial.mean - local.x.astype(float)
    return np.asarray(claim.initial.covariance) + np.outer(away, away)


def _settling(claim: Regional, S: Array) -> DiscountedCost:
    """The claim on the sum of e'M e + u~'R u~ over all time, M and R exactly positive (semi)definite."""
    size = np.sqrt(np.diag(S))
    values = np.linalg.eigvalsh(claim.Q * np.outer(size, size))
    M, R = claim.Q, claim.R
    if values[0] < SMALL * values[-1] or not values[-1] > 0:
        mean = float(np.trace(claim.Q @ S)) / len(S)
        M = M + FLOOR * (mean if mean > 0 else 1.0) * np.diag(1 / size**2)
    if not is_semidefinite(exact(R)):
        R = R + ROUNDED * np.trace(R) * np.eye(len(R))
    return DiscountedCost(M, R, 1.0, Gaussian(np.zeros(len(S)), S))


def _first(plant: Plant, local: ConewiseLaw, claim: DiscountedCost) -> tuple[MatrixCertificate | None, list[str]]:
    """The certificate of the first rung that gives one, and what became of the others."""
    loop, notes = close_loop(plant, local.inc), list[str]()
    for rung in LADDER:
        skipped = claim.refusal(loop, rung) or _too_large(Inequalities(loop, claim, rung))
        if not skipped:
            found = search(plant, local.inc, claim, rung)
            if found.holds():
                return found, notes
        notes.append(f"{rung.name}: {skipped or 'none'}")
    return None, notes


def _too_large(problem: Inequalities) -> str:
    size = sum(int(np.count_nonzero(unknown.free)) for unknown in problem.unknowns)
    return f"{size} unknowns are more than {MOST_UNKNOWNS}" if size > MOST_UNKNOWNS else ""


def _cost(plant: Plant, local: ConewiseLaw, claim: Regional, S: Array,
          settling: MatrixCertificate) -> MatrixCertificate | None:
    """A certificate of the claim's own cost, or None when nothing costs or none was found."""
    if not claim.Q.any() and not claim.R.any():
        return None
    rung: Multiplier = settling.multiplier
    wanted = DiscountedCost(claim.Q, claim.R, claim.discount, Gaussian(np.zeros(len(S)), S))
    found = search(plant, local.inc, wanted, rung)
    return found if found.holds() else None
