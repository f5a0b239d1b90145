"""The BMI loop: matrix inequality for the certificate, nonlinear program for the controller, in turn."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inc_casadi import lmi_search
from inc_casadi.arrays import number
from inc_casadi.brief import Brief
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.claims import DiscountedCost
from inc_casadi.claims.base import Claim
from inc_casadi.claims.together import Together
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.inequalities import Inequalities
from inc_casadi.loop import close_loop
from inc_casadi.multipliers import Multiplier, Relu, Sector, Slope, as_multiplier
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets.rules import whole

from .bmi_search import Search
from .certified_cost import cost_at
from .condition_graph import condition_graph, readable
from .controller_step import WAYS
from .feasible_start import make_feasible
from .law_family import Frozen, family

MOST_UNKNOWNS = 250  # of a rung that "auto" climbs to


@dataclass(frozen=True, eq=False)
class Alternation(Brief):
    """What `alternate` returns.

    inc, certificate: the law with the least certified bound and its certificate, which holds unless none was found at all;
    start_bound: the certified bound of the start, infinite where none was found; status: how the search ended, in words;
    seconds: wall time; history: one dict(round, phase, rung, bound, trial, accepted, radius, law, seconds) per round: the
    bound after it and the one that was tried; the law that was accepted, or None; phase is "cost", or "feasibility" with
    bounds for a future that fades faster.
    """

    inc: INC
    certificate: MatrixCertificate
    start_bound: float
    status: str
    seconds: float
    history: tuple[dict[str, Any], ...]

    @property
    def improvement(self) -> float:
        """Part of the start's bound that is gone; 0 without a bound before and after."""
        if not (np.isfinite(self.start_bound) and self.certificate.holds()):
            return 0.0
        return 1.0 - self.certificate.bound / self.start_bound

    def plot(self, path: str | Path | None = None, **options: Any) -> Any:
        """Return a Matplotlib figure of the certified bound by round and of what was tried, written to `path` if given.

        options: `width` and `dpi` of `inc_casadi.plotting.plot_alternation`.
        """
        from inc_casadi.plotting import plot_alternation
        return plot_alternation(self, path, **options)


def alternate(plant: Any, inc: INC, claim: Claim, *, kappa: float = 0.95, multiplier: str | Multiplier = "auto",
              way: str = "joint", frozen: Frozen = (), max_rounds: int = 40, seconds: float | None = None,
              progress: Callable[[dict[str, Any]], None] | None = None) -> Alternation:
    """Lower the certified cost b(theta) of a law by changing the law: a local search on the bilinear matrix inequality.

    Each round proposes a law within a trust region about the present one and solves the matrix inequality for it anew. The
    law is accepted only if the certificate made of those numbers holds and its bound has not risen; then the region grows,
    else it shrinks. So the bound never rises, and what is returned is certified whatever the solvers did. The ways to
    propose (`ControllerStep`):

        "joint"     IPOPT moves theta, P and multipliers together, the inequality L = R R' imposed
        "gradient"  a quasi-Newton model of b with the exact gradient of `certified_cost`, no inequality
        "fixed"     P and multipliers stay, the inequality is imposed, the model's slope is followed

    A start without a certificate is first made feasible in the same way, with a future that fades faster than the claim's
    (`make_feasible`).

    Parameters
    ----------
    plant : discrete-time Plant or control.StateSpace
    inc : the start; u = 0 at x = 0. Biases follow so that the units' rest points stay (`Family`)
    claim : DiscountedCost, or Together with one (Stability with a rate beside it, say)
    kappa : ||S W||_inf <= kappa for every law, S the units' largest slopes; in a weighted norm if the start needs it
    multiplier : a rung; or "auto": the rungs sector, slope, relu that apply and are small, one after the other
    way : as above
    frozen : names among W, U, V, K that stay, or a mapping to masks, True where the entry stays (`law_family.readout`)
    max_rounds : over all rungs
    seconds : time budget, after which the best so far is returned
    progress : called with the row of `history` after each round

    Raises
    ------
    InvalidInputError : another claim, an unknown way, a start with u not 0 at x = 0, or what `family` refuses
    DimensionError : shapes that do not fit

    Notes
    -----
    Local: where it ends depends on the start. Nothing is random. KeyboardInterrupt ends it with the best so far.

    The ways measured (`python -m benchmarks speed alternation`: slope multiplier, at most 20 rounds), by the certified bound
    over the cost of the best static linear gain; rounds in brackets; "four tanks" and "AC17" are plants of the suite:

        law                          start     joint        gradient     fixed
        2 states, ReLU                2.63     1.000 (3)    1.002 (20)   2.006 (20)
        3 states, tanh                3.76     1.000 (4)    1.219 (20)   1.864 (20)
        3 states, leaky ReLU          3.09     1.000 (4)    1.034 (20)   2.273 (20)
        4 states, K = 0 kept          1.10     1.065 (8)    1.067 (12)   1.067 (8)
        4 states, refused at first    none     1.000 (5)    none (20)    1.314 (20)
        AC17, tanh                   11.57     1.000 (4)    1.029 (20)   7.327 (20)
        four tanks, ReLU              6.68     1.003 (6)    1.035 (20)   1.755 (20)

    What can be reached. With V(x) = x'P x (every rung but "lifted") no law u = pi(C x) whatever is certified below the
    best static linear gain: write q(x, u) for the increase of the inequality, a quadratic form, convex in u. If for each y
    some u has q(x, u) <= 0 for all x with C x = y, q is concave there, so the u that minimizes its maximum is linear in y,
    u = K y, and the linear law satisfies the inequality with the same P. And a bounded law is certified globally never
    below the cost of the open loop: far out, its input does not count. Below these two there is room for "lifted" (not for
    bounded laws) and for `Regional` only.

    Source: alternation for bilinear matrix inequalities, Goh, Safonov, Papavassilopoulos (J. Global Optim. 7, 1995); the
    factorization, Burer, Monteiro (Math. Programming 95, 2003).

    Examples
    --------
    >>> from inc_casadi import Box
    >>> plant = Plant([[0.9, 0.3], [-0.2, 0.8]], [[0.0], [1.0]], [[1.0, 0.5]])
    >>> law = INC([[0.1, -0.2], [0.3, 0.0]], [[1.0], [-1.0]], [[0.1, 0.2]], [[0.0]])
    >>> claim = DiscountedCost(np.eye(2), 0.1, 0.95, Box([-1, -1], [1, 1]))
    >>> found = alternate(plant, law, claim, multiplier="sector")
    >>> found.certificate.prove().succeeded, found.improvement > 0.5
    (True, True)
    """
    began = time.perf_counter()
    plant = as_plant(plant)
    _check(plant, inc, claim, way)
    parts = family(plant, inc, kappa=kappa, frozen=frozen, second_moment=_cost_claim(claim).initial.second_moment)
    limit = np.inf if seconds is None else number("seconds", seconds, 0.0)
    search = Search(way, parts, whole("max_rounds", max_rounds, 0), began, limit, progress)
    rungs = _rungs(plant, inc, claim, multiplier)
    try:
        _run(search, plant, claim, rungs)
    except KeyboardInterrupt:
        search.status = "interrupted"
    certificate = (search.best.certificate if search.best is not None
                   else lmi_search.search(plant, search.family.start, claim, rungs[-1]))
    return Alternation(certificate.inc, certificate, search.start_bound, search.status, search.seconds,
                       tuple(search.history))


def _run(search: Search, plant: Plant, claim: Claim, rungs: list[Multiplier]) -> None:
    """Make the start feasible if need be, then lower the cost rung by rung."""
    graphs = [condition_graph(plant, search.family.start, claim, rung) for rung in rungs]
    for graph in graphs:
        search.keep(cost_at(graph, search.family.start))
    search.start_bound = np.inf if search.best is None else search.best.certificate.bound
    for rung, graph in zip(rungs, graphs, strict=True):
        if search.best is None:
            make_feasible(search, plant, claim, rung)
            search.keep(cost_at(graph, search.family.start))
    for graph in graphs:
        point = cost_at(graph, search.family.start)
        if point is not None:
            search.keep(point)
            search.descend(graph, point)


def _rungs(plant: Plant, inc: INC, claim: Claim, multiplier: str | Multiplier) -> list[Multiplier]:
    if multiplier != "auto":
        return [as_multiplier(multiplier)]
    loop = close_loop(plant, inc)
    rungs: list[Multiplier] = [Sector()]
    for rung in (Slope(), Relu()):
        if not claim.refusal(loop, rung) and _size(loop, claim, rung) <= MOST_UNKNOWNS:
            rungs.append(rung)
    return rungs


def _size(loop: Any, claim: Claim, rung: Multiplier) -> int:
    return sum(int(np.count_nonzero(unknown.free)) for unknown in Inequalities(loop, claim, rung).unknowns)


def _cost_claim(claim: Claim) -> DiscountedCost:
    parts = claim.claims if isinstance(claim, Together) else (claim,)
    for part in parts:
        if isinstance(part, DiscountedCost):
            return part
    raise InvalidInputError(f"{type(claim).__name__} has no cost to lower: DiscountedCost has, or Together with one")


def _check(plant: Plant, inc: INC, claim: Claim, way: str) -> None:
    if not isinstance(inc, INC):
        raise InvalidInputError(f"inc must be an INC, not {type(inc).__name__}")
    if way not in WAYS:
        raise InvalidInputError(f"way is {way!r}, but must be one of {', '.join(map(repr, WAYS))}")
    if not plant.discrete:
        raise InvalidInputError("the BMI loop is for discrete time, where the future fades per step, but the plant is "
                                "continuous (dt = 0): use plant.sampled(dt)")
    _cost_claim(claim)
    readable(claim)
    close_loop(plant, inc)
    claim.check(plant, inc)
    obstacle = claim.obstacle(plant, inc)
    if obstacle:
        raise InvalidInputError(f"the start cannot be certified: {obstacle}")
