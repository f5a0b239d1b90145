"""The start from model predictive control: its law exactly, as an INC, with a horizon that pays for its units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.arrays import Array, number
from inc_casadi.brief import Brief
from inc_casadi.errors import InvalidInputError, NotWellPosedError
from inc_casadi.inc import INC
from inc_casadi.mpc import MPC
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .yardstick import Yardstick, yardstick

SINGULAR = 1e10  # condition number from which on C counts as singular


@dataclass(frozen=True, eq=False)
class PredictiveStart(Brief):
    """A predictive law as an INC with the limits built in, and what was tried.

    inc: m horizon saturation units; mpc: the law that it is; cost: its mean cost by simulation; tried: (horizon, units,
    cost) of each; note: why the search for a horizon ended; yardstick: where the costs were measured.
    """

    inc: INC
    mpc: MPC
    cost: float
    tried: tuple[tuple[int, int, float], ...]
    note: str
    yardstick: Yardstick

    @property
    def horizon(self) -> int:
        """The horizon taken."""
        return self.mpc.horizon

    @property
    def sentence(self) -> str:
        """What was found, in one sentence."""
        ends = self.yardstick
        return (f"MPC over {self.horizon} steps is an INC with {self.inc.q} units and simulated cost {self.cost:.6g}; the "
                f"saturated LQR has {ends.regulator.mean():.6g}, the best input sequences {ends.optimum.mean():.6g}: "
                f"{100 * ends.closed(self.inc):.3g} % of the gap is closed. {self.note}")


def predictive_start(plant: Any, spec: Spec, units: int = 60, horizon: int | None = None, tol: float = 1e-3,
                     terminal: ArrayLike | None = None, samples: int = 200, seed: int = 0) -> PredictiveStart:
    """Return the predictive law for a spec as an INC, its horizon the shortest that is as good as any tried.

    For each x the law minimizes sum_{k<N} beta^k (x_k'Q x_k + u_k'R u_k) + beta^N x_N'P x_N over inputs within the box and
    applies u_0. P of the discounted LQR makes it the LQR where no limit is met within the horizon, and the best controller
    where none is met after it. The fixed point eta = sat((I - g M) eta - g (L x + l)) is the optimality condition, so the
    INC is the law itself and no approximation (`MPC.inc`).

    The horizons 1, 2, 3, 4, 6, 8, 12, ... with at most `units` units are tried in turn by simulation from the same states;
    the search ends early within tol of the best input sequences. The shortest within tol of
    the best tried is taken.

    Parameters
    ----------
    plant : discrete, its state measured: C square and nonsingular
    spec : Spec with a Box of inputs and R > 0
    units : the most hidden units
    horizon : fixes the horizon
    tol : relative difference of costs that counts as none
    terminal : P (n, n); that of the discounted LQR when left out
    samples, seed : of the initial states that costs are measured from (`yardstick`)

    Raises
    ------
    InvalidInputError : with the reason why this plant or spec has no such start
    NotWellPosedError : no horizon gives a program whose W is well posed in floats

    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    >>> spec = Spec(Q=np.eye(2), R=0.1, discount=0.95, initial=Box([-3, -1.5], [3, 1.5]), inputs=Box(-0.5, 0.5))
    >>> start = predictive_start(plant, spec)
    >>> start.horizon, bool(start.cost < start.yardstick.regulator.mean())
    (2, True)
    """
    plant = as_plant(plant)
    refusal = why_not(plant, spec, whole("units", units, 1))
    if refusal:
        raise InvalidInputError(refusal)
    tol = number("tol", tol, 0.0)
    ends = yardstick(plant, spec, samples=samples, seed=seed)
    P = ends.P if terminal is None else terminal
    if horizon is not None:
        law = _law(plant, spec, whole("horizon", horizon, 1), P)
        if not law[1].well_posedness().holds:
            raise NotWellPosedError(f"the program over {horizon} steps is too ill conditioned for floats: shorten it")
        return _start(ends, [law], [float(ends.costs(law[1]).mean())], tol, "The horizon was given.")
    return _searched(ends, P, units, tol)


def why_not(plant: Plant, spec: Spec, units: int) -> str:
    """Return why a problem has no predictive start with so many units, or "".

    >>> why_not(Plant(1.2, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)), 5)
    'R is singular, and then the minimizing inputs need not be unique: give each input a weight'
    """
    spec.check(plant)
    if not plant.discrete:
        return "predictive control needs discrete time, but the plant is continuous (dt = 0): plant.sampled(dt)"
    if spec.inputs is None:
        return "without input limits the predictive law is the LQR"
    if not isinstance(spec.inputs, Box):
        return "the inputs are a Polytope: its multipliers need not be unique, so the fixed point is one for a Box only"
    if plant.p != plant.n or np.linalg.cond(plant.C) > SINGULAR:
        return (f"the predictive law reads the state, but C ({plant.p} x {plant.n}) does not give it: start from static "
                "output feedback")
    if np.linalg.eigvalsh(spec.R)[0] <= 1e-12 * max(1.0, float(np.max(np.abs(spec.R)))):
        return "R is singular, and then the minimizing inputs need not be unique: give each input a weight"
    if units < plant.m:
        return f"a horizon of one step takes m = {plant.m} units, but only {units} are allowed"
    return ""


def _searched(ends: Yardstick, P: ArrayLike, units: int, tol: float) -> PredictiveStart:
    floor = float(ends.optimum.mean()) if np.all(np.isfinite(ends.regulator)) else -np.inf
    laws, found = [], []
    note = f"No longer horizon fits in {units} units."
    for N in _horizons(units // ends.plant.m):
        mpc, inc = _law(ends.plant, ends.spec, N, P)
        if not inc.well_posedness().holds:
            note = f"Over {N} steps the program is too ill conditioned for floats."
            break
        laws.append((mpc, inc))
        found.append(float(ends.costs(inc).mean()))
        if found[-1] <= (1 + tol) * floor:
            note = f"No input sequence is better by more than {100 * tol:.3g} %."
            break
    if not laws:
        raise NotWellPosedError("the program over one step is too ill conditioned for floats: scale the inputs and weights")
    return _start(ends, laws, found, tol, note)


def _start(ends: Yardstick, laws: list[tuple[MPC, INC]], found: list[float], tol: float, note: str) -> PredictiveStart:
    best = next(i for i, cost in enumerate(found) if cost <= (1 + tol) * min(found))
    mpc, inc = laws[best]
    tried = tuple((law.horizon, one.q, cost) for (law, one), cost in zip(laws, found, strict=True))
    return PredictiveStart(inc, mpc, found[best], tried, note, ends)


def _horizons(most: int) -> Iterator[int]:
    """1, 2, 3, 4, 6, 8, 12, 16, ... and last the longest."""
    powers = 2 ** np.arange(int(np.log2(most)) + 1)
    yield from sorted({*powers.tolist(), *(3 * powers // 2)[1:].tolist(), most} & set(range(1, most + 1)))


def _law(plant: Plant, spec: Spec, horizon: int, P: ArrayLike) -> tuple[MPC, INC]:
    assert isinstance(spec.inputs, Box)
    mpc = MPC(Plant(plant.A, plant.B, dt=plant.dt), spec.Q, spec.R, horizon, spec.inputs, P, spec.discount)
    inc = mpc.inc()
    return mpc, inc if plant.full_state else replace(inc, U=_read(inc.U, plant.C))


def _read(U: Array, C: Array) -> Array:
    return np.asarray(np.linalg.solve(C.T, U.T).T)
