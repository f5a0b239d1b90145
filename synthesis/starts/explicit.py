"""The start from explicit predictive control: the pieces of the law on a box, written as an INC with nilpotent W."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.affine_pieces.represent import Representation, represent
from inc_casadi.arrays import Array
from inc_casadi.brief import Brief
from inc_casadi.errors import InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.mpc import MPC
from inc_casadi.output_range import within_limits
from inc_casadi.pieces.critical_regions import CriticalRegions
from inc_casadi.pieces.regions import regions
from inc_casadi.plant import Plant, as_plant
from inc_casadi.sets import Box
from inc_casadi.sets.rules import whole
from inc_casadi.spec import Spec

from .predictive import why_not
from .yardstick import yardstick

ROOM = 1.05  # the box of the pieces, as a multiple of the box of the states met
STEPS = 100  # of the motions that are watched


@dataclass(frozen=True, eq=False)
class ExplicitStart(Brief):
    """A predictive law as a feedforward INC.

    inc: limits built in; mpc: the law that it is on `region`, a box that holds the motions watched; representation: how it
    was written; cost: its mean cost by simulation, from the states of `yardstick`.
    """

    inc: INC
    mpc: MPC
    region: Box
    representation: Representation
    cost: float

    @property
    def sentence(self) -> str:
        """What was found, in one sentence."""
        return f"Explicit MPC over {self.mpc.horizon} steps: {self.representation.sentence} Simulated cost {self.cost:.6g}."


def explicit_start(plant: Any, spec: Spec, horizon: int, units: int = 60, terminal: ArrayLike | None = None,
                   seconds: float = 20.0, samples: int = 200, seed: int = 0, pieces: int = 500_000) -> ExplicitStart:
    """Return a predictive law, exact on a box of states, as an INC without loops in W.

    The law of `predictive_start` is piecewise affine in x. Its critical regions on a box are listed exactly and written by
    hinges or by maxima and minima (prop:pwa_relu, `represent`). That takes fewer units than the fixed point where laws
    are few, and W is nilpotent, so training may begin there at once. The box holds the motions of the law from drawn states
    and from vertices, with 5 % to spare; outside it the INC is another law, clipped to the limits where its units do
    not keep them.

    Parameters
    ----------
    plant, spec, terminal, samples, seed : as in `predictive_start`
    horizon : N
    units : the most hidden units, those of the limits not counted
    seconds, pieces : for the regions, and how many simplices may make them up

    Raises
    ------
    InvalidInputError : the reasons of `predictive_start`; too many regions, or more units than allowed
    ConvergenceError : rounding keeps regions or units from being told apart

    >>> plant = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]])
    >>> spec = Spec(Q=np.eye(2), R=0.1, discount=0.95, initial=Box([-3, -1.5], [3, 1.5]), inputs=Box(-0.5, 0.5))
    >>> start = explicit_start(plant, spec, 2)
    >>> start.representation.pieces, start.inc.q, bool(abs(start.inc([1.0, 0.2]) - start.mpc.solve([1.0, 0.2])[0]) < 1e-6)
    (9, 2, True)
    """
    plant = as_plant(plant)
    refusal = why_not(plant, spec, max(whole("units", units, 1), plant.m))
    if refusal:
        raise InvalidInputError(refusal)
    assert isinstance(spec.inputs, Box)
    ends = yardstick(plant, spec, samples=samples, seed=seed)
    state = Plant(plant.A, plant.B, dt=plant.dt)
    mpc = MPC(state, spec.Q, spec.R, whole("horizon", horizon, 1), spec.inputs, ends.P if terminal is None else terminal,
              spec.discount)
    source = CriticalRegions(mpc)
    region = _visited(state, source, np.hstack([ends.x0, _corners(spec)]))
    found = regions(state, source, region, pieces, seconds)
    if found.ended:
        raise InvalidInputError(f"the regions of MPC over {horizon} steps were not all listed: {found.ended}; take a "
                                "shorter horizon, or the fixed point (`predictive_start`)")
    written = represent(found, saturations=True)
    if written.inc.q > units:
        raise InvalidInputError(f"MPC over {horizon} steps has {written.pieces} regions and takes {written.inc.q} units, "
                                f"but {units} are allowed: as a fixed point it takes {horizon * plant.m}")
    inc = written.inc if within_limits(written.inc, spec.inputs) else written.inc.with_saturated_output(spec.inputs)
    if not plant.full_state:
        inc = replace(inc, U=np.linalg.solve(plant.C.T, inc.U.T).T)
    return ExplicitStart(inc, mpc, region, written, float(ends.costs(inc).mean()))


def _visited(plant: Plant, law: CriticalRegions, x: Array) -> Box:
    low, high = x.min(axis=1), x.max(axis=1)
    size = np.max(np.abs(x))
    for _ in range(STEPS):
        x = plant.A @ x + plant.B @ law(x)
        if not np.max(np.abs(x)) <= 1e3 * size:
            raise InvalidInputError("the predictive law loses some initial states, so no box holds its motions: take a "
                                    "longer horizon or a smaller initial set")
        low, high = np.minimum(low, x.min(axis=1)), np.maximum(high, x.max(axis=1))
    middle, half = (low + high) / 2, ROOM * np.maximum((high - low) / 2, 1e-6 * size)
    return Box(middle - half, middle + half)


def _corners(spec: Spec) -> Array:
    try:
        return spec.initial.vertices
    except InvalidInputError:  # unbounded, or too many to list
        return np.zeros((spec.n, 0))
