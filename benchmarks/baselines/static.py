"""Static linear gains that keep the input limits at all times: the best one found, and the scaled regulator."""

from __future__ import annotations

from dataclasses import replace

from inc_casadi import INC, Box
from inc_casadi.arrays import Array
from inc_casadi.errors import InfeasibleError, InvalidInputError
from inc_casadi.linear import LinearCost, best_static_gain

from ..plants.paper import Case
from .improved import improved
from .kept import certified, largest_kept
from .linear import control_lqr_gain

SHRUNK, HALVINGS = 10, 1  # limits that are tried, each of which costs a search
STARTS, LARGE, FEW = 6, 2000, 2  # of a search; where vertices and facets multiply to more, it makes fewer


def best_linear_gain(case: Case, seed: int = 0) -> INC:
    """Return u = F y, the best found of the static gains that stabilize and keep the limits at all times, proved.

    `best_static_gain` asks for the limits at k = 0 only, F C x_0 in U for every initial state, and a loop may break them
    later. So its gain is taken if U is kept for ever, and t times the best gain without limits, with the largest t in (0, 1]
    found for which it is; where neither is to be had, the best gain of limits shrunk to t U. From the cheapest one
    `improved` goes on. It is an upper bound on the best of the class, which it need not be.

    case : limits with 0 inside, or none; seed : of the random starts of the search

    Raises
    ------
    INCError : no admissible gain was found

    >>> from ..plants import scalar
    >>> best_linear_gain(scalar(0.9))([1.0]).round(6).tolist()
    [-1.0]
    """
    if case.spec.inputs is None:
        return INC.linear(best_static_gain(case.plant, case.spec, seed=seed).F)
    whole = best_static_gain(case.plant, case.spec, seed=seed, starts=_starts(case)).F  # where there is none, this says why
    found = [one for one in (certified(case.plant, case.spec, whole), _scaled(case, seed)) if one is not None]
    return INC.linear(improved(case, min(found or [_shrunk(case, seed)], key=lambda one: one.bound)).controller.D_c)


def scaled_lqr(case: Case, seed: int = 0) -> INC:
    """Return u = t K x with the discounted LQR gain K and the largest t in (0, 1] found that keeps the limits at all times.

    sec:numerics scales K by what the limits allow on the initial set; here they are proved for ever, and stability too.
    The gain is python-control's.

    case : full state measured; seed is not used

    Raises
    ------
    InvalidInputError : the state is not measured
    InfeasibleError : no such t was found; of an unstable plant, the scaled gain may not stabilize

    >>> from ..plants import two_state
    >>> scaled_lqr(two_state()).K.round(4).tolist()
    [[-0.4271, -0.8229]]
    """
    plant, spec, _ = case
    if not plant.full_state:
        raise InvalidInputError("the plant does not measure its full state, so u = t K x is no output feedback")
    K = control_lqr_gain(plant, spec)
    return INC.linear(K if spec.inputs is None else largest_kept(plant, spec, lambda t: t * K).controller.D_c)


def _scaled(case: Case, seed: int) -> LinearCost | None:
    try:
        F = best_static_gain(case.plant, replace(case.spec, inputs=None), seed=seed, starts=_starts(case)).F
        return largest_kept(case.plant, case.spec, lambda t: t * F)
    except InfeasibleError:
        return None


def _shrunk(case: Case, seed: int) -> LinearCost:
    plant, spec, limits = case.plant, case.spec, case.spec.inputs
    if not isinstance(limits, Box):
        raise InvalidInputError(f"inputs is a {type(limits).__name__}, but shrinking the limits needs a Box")

    def within(t: float) -> Array | None:
        narrow = replace(spec, inputs=Box(t * limits.lower, t * limits.upper))
        try:
            return best_static_gain(plant, narrow, seed=seed, starts=_starts(case)).F
        except InfeasibleError:
            return None

    return largest_kept(plant, spec, within, SHRUNK, HALVINGS)


def _starts(case: Case) -> int:
    facets = 0 if case.spec.inputs is None else len(case.spec.inputs.h)
    return FEW if facets * 2**case.plant.n > LARGE else STARTS
