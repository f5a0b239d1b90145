"""A lower bound on the cost of every static linear gain: branch and bound over gains, with second-order models."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array, number
from ..certificate import FLOAT, Proof
from ..errors import InfeasibleError, InvalidInputError
from ..figures import at_least, at_most
from ..plant import as_plant
from ..sets import Gaussian
from ..sets.rules import whole
from ..spec import Spec
from .bound import Bound
from .gain_algebra import Gains
from .gain_box import FirstBox, first_box
from .gain_branching import Patience, branch
from .gain_cells import boxes, cell_bounds
from .gain_limits import GainLimits, anchors
from .gain_upper import first_gain, improved
from .halvings import Halvings
from .occurring import may_occur
from .value_iteration import discrete, unlimited

_SPARE = 1e-10  # share of the bound left for machines that add up in another order
_MOVES = 12  # later moves that are looked at when the limits hold always
_MOST_ENTRIES = 12
_BEYOND = 1e3  # without any gain known, the first box holds those of up to so many times what every controller costs


@dataclass(frozen=True, eq=False)
class StaticGainBound(Bound):
    """The bound of `static_output_feedback`, with the boxes of gains that prove it.

    Parameters
    ----------
    gain : F (m, p), the best one found, or None
    upper : its cost tr(P_F S0), or infinity
    points : (n, a) initial states that may occur, from which limits are counted
    moves : 0 when limits are counted at the first move only
    coordinates : T (n, n), x = T z, in which costs are bounded
    box : the first box of gains
    record : how it was cut
    """

    gain: Array | None
    upper: float
    points: Array = field(repr=False)
    moves: int
    coordinates: Array | None = field(repr=False)
    box: FirstBox = field(repr=False)
    record: Halvings = field(repr=False)

    @property
    def gap(self) -> float:
        """By how much the best gain found may exceed the best one there is: (upper - value) / upper, or infinity."""
        return (self.upper - self.value) / self.upper if isfinite(self.upper) and self.upper else self.upper - self.value

    @property
    def cells(self) -> int:
        """The number of boxes that cover the gains."""
        return self.record.leaves.size

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        where = "at all times" if self.moves else "at the first move"
        kept = "" if self.spec.inputs is None else f" that keeps the input limits {where} from every initial state"
        known = (f"the best one found costs {at_most(self.upper)}" if isfinite(self.upper)
                 else "none of finite cost was found")
        return (f"Every static linear gain u = F y{kept} costs at least {at_least(self.value)} on average over the "
                f"initial states; {known}.")

    @property
    def limits(self) -> GainLimits:
        """The input limits as half-spaces of gains."""
        return GainLimits(Gains(self.plant, self.spec), self.points, self.moves, self.coordinates)

    def dual(self) -> tuple[float, float]:
        """Return the least bound of all boxes, computed anew, and an allowance for other orders of summation."""
        found = cell_bounds(self.limits, *boxes(self.box, self.record), self.value + 2 * _SPARE * abs(self.value))
        value = min(float(np.min(found.value)), self.box.level)
        return value, _SPARE * abs(value)

    def reason(self) -> str:
        """Return in words why the stored numbers do not prove the value, or nothing.

        The initial states must occur, the first box must hold all gains that count, the cuts must leave nothing out,
        and no box may have a lower bound.
        """
        if self.points.size and not may_occur(self.spec.initial, self.points):
            return "an initial state that is counted cannot occur"
        if not self._has_coordinates():
            return "the coordinates are singular"
        found = self.box.reason(self.limits)
        if found:
            return found
        if not self.limits.rounded(np.maximum(np.abs(self.box.lower), np.abs(self.box.upper))):
            return "the gains are too large for the rounding that is allowed for"
        if self.record.roots != 1 or not self.record.sound(self.plant.m * self.plant.p):
            return "the boxes do not cover the first box"
        return "" if super().holds() else "a box of gains is not proved to cost so much"

    def _has_coordinates(self) -> bool:
        T, n = self.coordinates, self.plant.n
        return T is None or T.shape == (n, n) and bool(np.all(np.isfinite(T)) and np.all(np.any(T, axis=1))
                                                       and np.linalg.matrix_rank(T) == n)

    def holds(self) -> bool:
        """Return whether the stored numbers prove the value: NumPy only, no solver."""
        return not self.reason()

    def prove(self) -> Proof:
        """Settle the bound: the first box in exact arithmetic, the bounds of the boxes with every rounding bounded."""
        begun = perf_counter()
        found = self.reason()
        return Proof(not found, FLOAT, perf_counter() - begun, found)


def static_output_feedback(plant: Any, spec: Spec, *, limits: str = "initial", gap: float = 0.01, cells: int = 200_000,
                           seconds: float = 60.0, seed: int = 0, verbose: bool = False) -> StaticGainBound:
    """Return a lower bound on the expected cost of every static linear gain u = F y = F C x.

    J(F) = tr(P_F S0), P_F = Q + C'F'RFC + beta (A + BFC)'P_F (A + BFC), infinite where the sum diverges, is not convex
    in F. A first box holds every gain that keeps the limits, or costs little enough; it is cut into smaller ones until
    each is known to cost at least (1 - gap) times the best gain found, or to hold no admissible gain.
    On a box J is bounded from below by its expansion to second order around the middle and a remainder that is verified
    (`gain_models.models`), minimized over the half-spaces of admissible gains by weak duality.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time, m p <= 12 (up to 6 is quick)
    spec : Spec; initial on a bounded set when there are input limits
    limits : "initial": the gains with H_u F C v <= h_u for every initial state v; "always": those that keep the limits
        along all trajectories, a smaller class with a minimum at least as high; of later moves the first 12 count
    gap : relative, in (0, 1), at which to stop
    cells : most boxes
    seconds : wall time after which to stop; whenever it stops, the bound found so far is returned
    seed : of the search for a good gain
    verbose : whether to print progress

    Returns
    -------
    StaticGainBound : value, gain and upper (the best one found and its cost), gap, cells. Limits are widened by 1e-9 of
    their size. Without any gain of finite cost the bound grows until cells or seconds are used up.

    Raises
    ------
    InvalidInputError : a continuous plant, a Gaussian initial state with input limits, m p > 12, arguments out of range,
        or neither the limits nor the cost of two steps bounds the gains
    InfeasibleError : no gain keeps the limits
    DimensionError : spec does not fit the plant
    SolverError : SciPy or Clarabel is missing

    Notes
    -----
    Necessary for every gain of the class. Source: L_SOF of sec:general_sof; a certified cost below it beats all of
    F_SOF. No stability is assumed: gains of infinite cost are covered by smaller discounts.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> scalar = Spec(Q=1.0, R=0.0, discount=0.5, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> bound = static_output_feedback(Plant(1.5, 1.0), scalar, gap=1e-3)
    >>> round(bound.upper, 6), bound.gap < 1e-3, bound.holds()  # 1 / (3 (1 - beta / 4)), thm:lsof_sep
    (0.380952, True, True)
    """
    begun = perf_counter()
    plant = discrete(as_plant(plant))
    spec.check(plant)
    patience = Patience(number("gap", gap, 0.0, 1.0, open_low=True, open_high=True), whole("cells", cells, 1),
                        number("seconds", seconds, 0.0, open_low=True))
    seed = whole("seed", seed, 0)
    classes = _limits(Gains(plant, spec), limits, seed)
    best = first_gain(classes, seed)
    classes = classes.around(best.F)
    level = best.cost * (1 + 1e-6) if isfinite(best.cost) else _BEYOND * max(unlimited(plant, spec).value, 1e-9)
    box = first_box(classes, level)
    patience = replace(patience, seconds=patience.seconds - (perf_counter() - begun))
    found = branch(classes, box, best, patience, lambda bounds, known: improved(classes, bounds, known, seed),
                   print if verbose else _silent)
    if not isfinite(found.value):
        raise InfeasibleError(f"no static gain u = F y keeps the input limits: none of {found.record.leaves.size} boxes of "
                              "gains holds one that does")
    value = min(found.value, box.level)
    best = found.best
    return StaticGainBound(plant, spec, value - _SPARE * abs(value), perf_counter() - begun,
                           best.F if isfinite(best.cost) else None, best.cost, classes.points, classes.moves, classes.T,
                           box, found.record)


def _limits(gains: Gains, limits: str, seed: int) -> GainLimits:
    if limits not in ("initial", "always"):
        raise InvalidInputError(f'limits is {limits!r}, but must be "initial" or "always"')
    if gains.d > _MOST_ENTRIES:
        raise InvalidInputError(f"F has {gains.d} entries, but boxes of gains are cut up to {_MOST_ENTRIES}")
    if gains.spec.inputs is None:
        return GainLimits(gains, np.zeros((gains.plant.n, 0)), 0)
    if isinstance(gains.spec.initial, Gaussian):
        raise InvalidInputError("initial is a Gaussian, which no bounded set carries, so no gain but zero keeps the "
                                "input limits: use a distribution on a bounded set, or inputs=None")
    return GainLimits(gains, anchors(gains.spec.initial, seed), _MOVES if limits == "always" else 0)


def _silent(line: str) -> None:
    pass
