"""The invariance of a region by mixed-integer programs: one for each half-space, solved by HiGHS."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from .activations.base import Pieces
from .arrays import Array
from .claims.invariance import Invariance, Rows, Slacks
from .errors import InvalidInputError, SolverError
from .inc import INC
from .output_bounds import Boxes, hidden_bounds_on
from .plant import Plant

TOLERANCE = 1e-6  # HiGHS takes a constraint, and an integer, for satisfied within this


@dataclass
class _Table:
    """Constraints low <= A v <= high as they are collected, with bounds on the variables and which are integers."""

    width: int
    rows: list[Array] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)

    def add(self, entries: dict[int, float], low: float, high: float) -> None:
        row = np.zeros(self.width)
        row[list(entries)] = list(entries.values())
        self.rows.append(row)
        self.low.append(low)
        self.high.append(high)


@dataclass(frozen=True, eq=False)
class Program:
    """low <= A v <= high, lower <= v <= upper, v_i in {0, 1} where integral; v starts with (x, eta).

    A (r, N); low, high (r,); lower, upper (N,); integral (N,) of 0 and 1.
    """

    A: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    integral: Array


def program(plant: Plant, inc: INC, claim: Invariance) -> Program:
    """Return the program whose points are the region's x with eta = phi(W eta + U C x + b).

    The fixed point is an equation among the variables, so W may be anything; by well-posedness it leaves one eta for
    each x. A unit whose kinks k_1 < ... < k_K lie within the interval [a, b] of its z has z = a + sum_j w_j and
    eta = phi(a) + sum_j slope_j w_j over the K + 1 segments, filled in order: w_j = L_j before w_{j+1} > 0, which binaries
    d_j enforce by w_j >= L_j d_j and w_{j+1} <= L_{j+1} d_j. Its relaxation is the convex hull of the unit's graph. The
    intervals come from `hidden_bounds_on` over the region's bounding box.

    Raises InvalidInputError when a unit is not piecewise affine.

    >>> from inc_casadi import Box
    >>> int(program(Plant([[1.0]], [[1.0]]), INC.saturated([[-2.0]], 1.0), Invariance(Box([-1.0], [1.0]))).integral.sum())
    2
    """
    low, high = bounding_box(claim)
    box = hidden_bounds_on(inc, plant.C, Boxes(low[None], high[None]))
    ends = zip(box.z_low[0], box.z_high[0], strict=True)
    segments = [_segments(pieces, *pair) for pieces, pair in zip(_pieces(inc), ends, strict=True)]
    n, q = plant.n, inc.q
    count = sum(len(rise) for _, _, rise, _ in segments)
    table = _Table(n + q + count + count - q)
    lower, upper = np.zeros(table.width), np.ones(table.width)
    lower[:n], upper[:n] = low, high
    lower[n:n + q], upper[n:n + q] = -np.inf, np.inf
    for row, limit in zip(claim.region.H, claim.region.h, strict=True):
        table.add(dict(enumerate(row)), -np.inf, float(limit))
    w, d, drive = n + q, n + q + count, inc.U @ plant.C
    for i, (start, value, rise, length) in enumerate(segments):
        upper[w:w + len(rise)] = length
        ahead = dict(enumerate(drive[i])) | {n + j: float(inc.W[i, j]) for j in range(q)}
        table.add(ahead | {w + j: -1.0 for j in range(len(rise))}, start - inc.b[i], start - inc.b[i])
        table.add({n + i: 1.0} | {w + j: -float(rise[j]) for j in range(len(rise))}, value, value)
        for j in range(len(rise) - 1):
            table.add({w + j: 1.0, d: -float(length[j])}, 0.0, np.inf)
            table.add({w + j + 1: 1.0, d: -float(length[j + 1])}, -np.inf, 0.0)
            d += 1
        w += len(rise)
    integral = np.zeros(table.width)
    integral[n + q + count:] = 1.0
    return Program(np.array(table.rows), np.array(table.low), np.array(table.high), lower, upper, integral)


def _pieces(inc: INC) -> list[Pieces]:
    found = [unit.pieces for unit in inc.activations]
    for i, pieces in enumerate(found):
        if pieces is None:
            raise InvalidInputError(f"hidden unit {i} has activation {inc.activations[i]}, which is not piecewise affine: a "
                                    "mixed-integer program does not apply")
    return [pieces for pieces in found if pieces is not None]


def bounding_box(claim: Invariance) -> tuple[Array, Array]:
    """Return the ends (n,) of a box that holds the region; for a polytope a little enlarged, since corners are rounded."""
    corners = claim.region.vertices
    low, high = corners.min(axis=1), corners.max(axis=1)
    room = 1e-9 * (high - low)
    return low - room, high + room


def _segments(pieces: Pieces, a: float, b: float) -> tuple[float, float, Array, Array]:
    """Start, phi(start), slopes and lengths of the affine segments of a unit on [a, b]."""
    kinks = pieces.kinks[(pieces.kinks > a) & (pieces.kinks < b)]
    ends = np.concatenate([[a], kinks, [b]])
    index = pieces.index((ends[:-1] + ends[1:]) / 2)
    value = pieces.slopes[index[0]] * a + pieces.intercepts[index[0]]
    return float(a), float(value), pieces.slopes[index], np.diff(ends)


def slacks_by_programs(plant: Plant, inc: INC, claim: Invariance, seconds: float = 60.0) -> Slacks:
    """Return the slack of every half-space: `least` from the solver's dual bound, `reached` at the point it found.

    What it rests on: HiGHS satisfies constraints within 1e-6 and its bounds are computed in floats, so a slack below that
    decides nothing, and nothing here is a proof. seconds: for all programs together.

    Raises InvalidInputError when a unit is not piecewise affine, SolverError when a program is found infeasible.

    >>> from inc_casadi import Box
    >>> claim = Invariance(Box([-1.0], [1.0]), Box([-2.0], [2.0]))
    >>> slacks_by_programs(Plant([[1.0]], [[1.0]]), INC.linear([[-0.5]]), claim).least.round(6).tolist()
    [1.5, 1.5, 0.5, 0.5]
    """
    start = time.perf_counter()
    problem, rows = program(plant, inc, claim), claim.rows(plant)
    gain, hidden = rows.G @ inc.K @ plant.C + rows.E, rows.G @ inc.V
    shift = rows.G @ inc.d - rows.t
    least, points, nodes, ended = np.full(len(shift), -np.inf), np.full((len(shift), plant.n), np.nan), 0, ""
    for i in range(len(shift)):
        left = seconds - (time.perf_counter() - start)
        if left <= 0:
            ended = f"the time limit of {seconds:g} s"
            break
        cost = np.zeros(len(problem.lower))
        cost[:plant.n], cost[plant.n:plant.n + inc.q] = -gain[i], -hidden[i]
        bound, point, count, ran_out = _solved(problem, cost, left)
        least[i], nodes, ended = bound - shift[i], nodes + count, ended or ran_out
        if point is not None:
            points[i] = point[:plant.n]
    return Slacks(least, _at(plant, inc, rows, points), points, ended, nodes, time.perf_counter() - start)


def _solved(problem: Program, cost: Array, seconds: float) -> tuple[float, Array | None, int, str]:
    """The solver's lower bound on the cost, the best point, the nodes used, and the limit that was reached."""
    from scipy.optimize import Bounds, LinearConstraint, milp

    found = milp(cost, integrality=problem.integral, bounds=Bounds(problem.lower, problem.upper),
                 constraints=LinearConstraint(problem.A, problem.low, problem.high),
                 options={"time_limit": seconds, "mip_rel_gap": 1e-7})
    if found.status not in (0, 1):
        raise SolverError(f"HiGHS did not solve a mixed-integer program over the region: {found.message}")
    bound = getattr(found, "mip_dual_bound", None)
    if not problem.integral.any() and found.status == 0:
        bound = found.fun
    value = -np.inf if bound is None or not np.isfinite(bound) else float(bound)
    return value, found.x, int(getattr(found, "mip_node_count", 0) or 0), "the time limit" if found.status == 1 else ""


def _at(plant: Plant, inc: INC, rows: Rows, points: Array) -> Array:
    """The slack of each row at its own point, infinite where there is none."""
    known = np.all(np.isfinite(points), axis=1)
    x = np.where(known[:, None], points, 0.0)
    values = rows.t - (rows.E * x).sum(axis=1) - (rows.G * inc(plant.C @ x.T).T).sum(axis=1)
    return np.where(known, values, np.inf)
