"""A lower bound on the cost of every controller whatever: open-loop optima at centroids, and Jensen's inequality."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array
from ..figures import at_least
from ..plant import Plant, as_plant
from ..sets import Box
from ..sets.rules import whole
from ..spec import Spec
from .bound import Bound
from .moves import UNIT, minorant, rollout
from .partition import Cells, partition
from .sequences import optimal_sequences
from .value_iteration import discrete, settled_steps, unlimited, value_iteration, weighed

_FIRST_HORIZON, _LAST_HORIZON = 10, 80
_VERTEX_TOL = 1e-12  # relative error of the vertices of a polytope of inputs, which Qhull computes


@dataclass(frozen=True, eq=False)
class Sequences:
    """Trial input sequences u (T, m, c) for the cells `members` (c,), which share a horizon T."""

    members: np.ndarray
    u: Array


@dataclass(frozen=True, eq=False)
class AnyControllerBound(Bound):
    """The bound of `any_controller`, with the trial sequences that prove it.

    Parameters
    ----------
    steps : of value iteration from zero, the horizon T of the sequences included
    cells : partition of the initial distribution
    sequences : one group for each horizon; every cell belongs to one
    """

    steps: int
    cells: Cells = field(repr=False)
    sequences: tuple[Sequences, ...] = field(repr=False)

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        return (f"Every controller whatever that keeps the input limits (nonlinear, dynamic or predictive, with the "
                f"full state measured) costs at least {at_least(self.value)} on average over the initial states.")

    def dual(self) -> tuple[float, float]:
        """Return the value proved by the stored sequences, and the rounding allowance."""
        P, _ = value_iteration(self.plant, self.spec, self.steps)
        values = np.full(self.cells.probabilities.size, -np.inf)
        for group in self.sequences:
            x0 = self.cells.centroids[:, group.members]
            values[group.members] = cell_values(self.plant, self.spec, P[self.steps - len(group.u)], x0, group.u)
        return _expected(self.spec, P[self.steps], self.cells, values)

    def holds(self) -> bool:
        """Return whether the stored numbers prove the value: NumPy only, no solver.

        The cells must share the mass, the mean and, up to a covariance inside the cells, the second moment of x_0.
        """
        return self.cells.divide(self.spec.initial) and super().holds()


def any_controller(plant: Any, spec: Spec, cells: int = 1600, horizon: int | None = None) -> Bound:
    """Return a lower bound on the expected cost of every admissible controller: nonlinear, dynamic, with full state.

    No controller does better from x_0 than the best input sequence chosen for that x_0,
    V(x_0) = min over u_k in the limits of sum_{k<T} beta^k (x_k'Q x_k + u_k'R u_k) + beta^T x_T'P x_T,
    where P is value iteration from zero, a lower bound on what follows. V(x) - x'Pi x is convex in x, with Pi the same
    value iteration T steps on (what limits cost is a minimum of sums of squares), so by Jensen's inequality

        E cost >= tr(Pi S0) + sum_i p_i (V(c_i) - c_i'Pi c_i)

    over cells of probability p_i and mean c_i. For V(c_i) stands the tangent plane of the cost at the sequence found,
    minimized over all sequences within the limits: at most V(c_i), whatever sequence was found.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time; its C is not used, the bound covers full information
    spec : Spec; without input limits the bound is tr(P S0) of value iteration, the discounted LQR cost
    cells : about how many cells to cut the initial distribution into; more cells raise the bound
    horizon : T, or None: 10, doubled up to 80 for the cells whose states have not yet come to where the limits are
        never met again

    Raises
    ------
    DimensionError, InvalidInputError : spec does not fit the plant, a continuous plant, cells or horizon < 1

    Notes
    -----
    Necessary for every controller, so a controller that costs no more is optimal. Source: dynamic programming and
    Jensen's inequality; compare prop:no_arbitrary_sof, which no bound for a subclass can improve on.

    Examples
    --------
    >>> from inc_casadi import Box, Plant, Spec
    >>> scalar = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> bound = any_controller(Plant(1.5, 1.0), scalar, cells=600)
    >>> round(float(bound), 5), bound.holds()  # 1/3 + 1/36 is attained by u = -sat(1.5 x)
    (0.36111, True)
    """
    begun = perf_counter()
    plant = discrete(as_plant(plant))
    spec.check(plant)
    cells = whole("cells", cells, 1)
    last = _LAST_HORIZON if horizon is None else whole("horizon", horizon, 1)
    if spec.inputs is None:
        return unlimited(plant, spec)
    steps = settled_steps(plant, spec) + last
    P, K = value_iteration(plant, spec, steps)
    parts = partition(spec.initial, cells)
    first = min(_FIRST_HORIZON, last) if horizon is None else last
    groups, values = _search(plant, spec, P, K, parts.centroids, (first, last))
    value, allowance = _expected(spec, P[steps], parts, values)
    return AnyControllerBound(plant, spec, value - allowance, perf_counter() - begun, steps, parts, groups)


def _search(plant: Plant, spec: Spec, P: Array, K: Array, x0: Array,
            horizons: tuple[int, int]) -> tuple[tuple[Sequences, ...], Array]:
    # Sequences for every centroid, with a longer horizon where a shorter one ends before the limits are left behind.
    assert spec.inputs is not None
    T, last = horizons
    values, chosen = np.full(x0.shape[1], -np.inf), np.zeros(x0.shape[1], dtype=int)
    pending: np.ndarray = np.arange(x0.shape[1])
    tried: list[Sequences] = []
    while pending.size:
        tail = P[len(P) - 1 - T]
        u = optimal_sequences(plant, spec, spec.inputs, tail, x0[:, pending], T)
        found = cell_values(plant, spec, tail, x0[:, pending], u)
        better = found > values[pending]
        values[pending[better]], chosen[pending[better]] = found[better], len(tried)
        tried.append(Sequences(pending, u))
        if 2 * T > last:
            break
        pending = pending[~_free(plant, spec, K, rollout(plant.A, plant.B, x0[:, pending], u)[-1], T)]
        T *= 2
    kept = [chosen[group.members] == index for index, group in enumerate(tried)]
    pairs = zip(tried, kept, strict=True)
    return tuple(Sequences(group.members[k], group.u[:, :, k]) for group, k in pairs if np.any(k)), values


def _free(plant: Plant, spec: Spec, K: Array, x: Array, T: int) -> np.ndarray:
    # Whether the unlimited optimum u = K x keeps the limits for another T steps from the columns of x.
    assert spec.inputs is not None
    free = np.ones(x.shape[1], dtype=bool)
    for _ in range(T):
        free &= spec.inputs.contains(K @ x)
        x = (plant.A + plant.B @ K) @ x
    return free


def cell_values(plant: Plant, spec: Spec, P: Array, x0: Array, u: Array) -> Array:
    """Return what any input sequences within the limits cost at least from x0 (n, c), seen from trial sequences u.

    The tangent of the cost at u (T, m, c), minimized over all sequences by the support function of the limits; `slack`
    of the minorant is subtracted.
    """
    assert spec.inputs is not None
    reach = np.max(np.abs(spec.inputs.vertices), axis=1)[None, :, None]
    below = minorant(plant, spec, P, rollout(plant.A, plant.B, x0, u), u, reach)
    T, m, c = u.shape
    flat = -below.inputs.transpose(1, 0, 2).reshape(m, T * c)
    support = np.asarray(spec.inputs.support(flat)).reshape(T, c).sum(axis=0)
    value = np.sum(below.state * x0, axis=0) - below.offset - support - below.slack
    if not isinstance(spec.inputs, Box):
        value -= _VERTEX_TOL * np.sum(np.abs(below.inputs) * reach, axis=(0, 1))
    return value


def _expected(spec: Spec, Pi: Array, cells: Cells, values: Array) -> tuple[float, float]:
    # tr(Pi S0) + sum p_i (V_i - c_i'Pi c_i), with V_i >= c_i'Pi c_i used where rounding or a poor sequence hides it.
    c = cells.centroids
    smooth = np.sum(c * (Pi @ c), axis=0)
    parts = cells.probabilities * np.maximum(values - smooth, 0.0)
    mean, allowance = weighed(Pi, spec.initial.second_moment)
    sizes = cells.probabilities * (np.abs(values) + np.sum(np.abs(c) * (np.abs(Pi) @ np.abs(c)), axis=0))
    return mean + float(np.sum(parts)), allowance + 4 * UNIT * (len(Pi) + 32) * float(np.sum(sizes))
