"""Start a controller with memory from a full-dimensional set: the law folds every start of its state onto xi_0."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..activations import ReLU
from ..arrays import Array
from ..claims.regional import Regional
from ..errors import DimensionError, InvalidInputError
from ..inc import INC
from ..output_range import within_limits
from ..plant import Plant
from ..sets import Box, Polytope
from ..simulate import simulate
from .controller import DynamicINC
from .extended import beside, blkdiag, extended

_ROOM, _STEPS, _SAMPLES = 2.0, 200, 500


@dataclass(frozen=True, eq=False)
class Folded:
    """A loop and a claim that `certify` takes as they are: the extended plant, the folded law, the regional claim."""

    plant: Plant
    inc: INC
    claim: Regional


def folded(plant: Any, dynamic: DynamicINC, claim: Regional, memory: Box) -> Folded:
    """Return the regional claim about plant and dynamic controller as one about a static law from a full-dimensional set.

    Exact pieces start from sets with an interior, and (x_0, xi_0) with xi_0 fixed has none. Let lo <= xi <= hi be the box
    `memory`, and for each coordinate fold

        g(w) = w - 2 max(w - hi, 0) + max(w - t, 0),  t = 2 hi - xi_0:   g(w) = w for w <= hi, g(w) = xi_0 for w >= t.

    The law (y, w) -> law(y, g(w)) is an INC of 2 l more ReLU units. From any w_0 in [t, t + hi - lo] its first move is that
    of law(y_0, xi_0), and as long as xi_1, xi_2, ... stay below hi all later ones are those of the dynamic controller. The
    claim returned says they do: its inputs are (u, xi+) in `claim.inputs` x `memory`. Hence

        (folded loop, from X_0 x [t, t + hi - lo]) keeps its limits, converges, costs J
            <=>  (plant, dynamic controller, from X_0 and xi_0) does, with xi in `memory`;

    w_0 is uniform and the cost does not depend on it, so J is the expectation over x_0, and the largest cost the same.

    Limits of u that the readout keeps for every argument (`within_limits`, decided in Fractions) need no watching: for
    them, and where the claim has none, the set of u is replaced by a box that is wide enough, so that an input resting on
    its limit leaves room.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    dynamic : DynamicINC, piecewise affine
    claim : Regional about the plant, of n states and m inputs
    memory : Box in R^l

    Raises
    ------
    DimensionError : something does not fit
    InvalidInputError : xi_0 is not in `memory`, or 2 hi - xi_0 is not a float, so that the fold would start elsewhere

    Examples
    --------
    >>> delay = DynamicINC(INC.linear([[-1.0, -0.5], [1.0, 0.0]]), [0.5])
    >>> problem = folded(Plant(1.5, 1.0), delay, Regional(Box(-1, 1), Box(-3, 3), 1.0, 0.0, 0.9), Box(-4, 4))
    >>> problem.claim.initial.support.lower.tolist(), problem.inc([[1.0, 1.0], [2.0, 9.0]]).tolist()
    ([-1.0, 7.5], [[-2.0, -1.25], [1.0, 1.0]])
    """
    wide, law = extended(plant, dynamic)
    l = dynamic.order
    if memory.dimension != l:
        raise DimensionError(f"memory is a box in R^{memory.dimension}, but the controller has order {l}")
    if claim.Q.shape[0] != wide.n - l or claim.R.shape[0] != dynamic.m:
        raise DimensionError(f"the claim speaks of {claim.Q.shape[0]} states and {claim.R.shape[0]} inputs, but the plant "
                             f"has {wide.n - l} and {dynamic.m}")
    top = _fold_ends(dynamic.xi_0, memory)
    region = claim.initial.support
    assert isinstance(region, Box | Polytope)
    starts = beside(region, Box(top, top + (memory.upper - memory.lower)))
    nothing = np.zeros((l, l))
    inputs = beside(watched(dynamic, claim), memory)
    return Folded(wide, _folded_law(law, dynamic.p, memory.upper, top),
                  Regional(starts, inputs, blkdiag(claim.Q, nothing), blkdiag(claim.R, nothing), claim.discount))


def built_in(dynamic: DynamicINC, claim: Regional) -> bool:
    """Whether there are no limits of u, or the readout keeps them whatever it is given.

    >>> built_in(DynamicINC(INC.linear(np.ones((2, 2))), [0.0]), Regional(Box(-1, 1), Box(-1, 1), 1.0, 0.0))
    False
    """
    return claim.inputs is None or within_limits(dynamic.readout, claim.inputs)


def watched(dynamic: DynamicINC, claim: Regional) -> Box | Polytope:
    """Return the set of u that the pieces compare with: the limits, or something wide where nothing need be compared.

    >>> watched(DynamicINC(INC.linear(np.ones((2, 2))), [0.0]), Regional(Box(-1, 1), None, 1.0, 0.0)).upper.tolist()
    [1000000.0]
    """
    if claim.inputs is None:
        return Box(np.full(dynamic.m, -1e6), np.full(dynamic.m, 1e6))
    if not built_in(dynamic, claim):
        return claim.inputs
    axes = np.eye(dynamic.m)
    lower, upper = -np.asarray(claim.inputs.support(-axes)), np.asarray(claim.inputs.support(axes))
    return Box(lower - (upper - lower), upper + (upper - lower))


def visited(plant: Any, dynamic: DynamicINC, claim: Regional, seed: int = 0) -> Box:
    """Return a box for xi, at least twice as wide as what simulation visits, its ends powers of two: a guess.

    >>> delay = DynamicINC(INC.linear([[-1.0, -0.5], [1.0, 0.0]]), [0.0])
    >>> visited(Plant(1.5, 1.0), delay, Regional(Box(-1, 1), None, 1.0, 0.0)).upper.tolist()
    [2.0]
    """
    wide, law = extended(plant, dynamic)
    x = claim.initial.sample(_SAMPLES, np.random.default_rng(seed))
    start = np.vstack([x, np.repeat(dynamic.xi_0[:, None], x.shape[1], axis=1)])
    with np.errstate(over="ignore", invalid="ignore"):
        xi = simulate(wide, law, start, steps=_STEPS).x[-dynamic.order:]
    largest = np.max(np.abs(xi), axis=(1, 2))
    ends = 2.0 ** np.ceil(np.log2(np.clip(np.nan_to_num(largest, nan=1e6), 1e-3, 1e6) * _ROOM))
    return Box(-ends, ends)


def _fold_ends(xi_0: Array, memory: Box) -> Array:
    outside = np.flatnonzero((xi_0 < memory.lower) | (xi_0 > memory.upper))
    for i in outside:
        raise InvalidInputError(f"xi_0[{i}] = {xi_0[i]:g} is not in memory, [{memory.lower[i]:g}, {memory.upper[i]:g}]")
    top = 2 * memory.upper - xi_0
    for k, (end, high, wanted) in enumerate(zip(top, memory.upper, xi_0, strict=True)):
        if 2 * Fraction(high) - Fraction(end) != Fraction(wanted):
            raise InvalidInputError(f"2 * {float(high)!r} - xi_0[{k}] is not a float, so the fold would start xi elsewhere: "
                                    f"start from xi_0[{k}] = {float(2 * high - end)!r}, or take an upper end of memory with "
                                    "few digits")
    return top


def _folded_law(law: INC, p: int, high: Array, top: Array) -> INC:
    l, q = high.size, law.q
    bend = np.hstack([-2 * np.eye(l), np.eye(l)])  # g(w) = w + bend [max(w - hi, 0); max(w - t, 0)]
    reads = np.hstack([np.zeros((l, p)), np.eye(l)])
    W = np.block([[law.W, law.U[:, p:] @ bend], [np.zeros((2 * l, q + 2 * l))]])
    return INC(W, np.vstack([law.U, reads, reads]), np.hstack([law.V, law.K[:, p:] @ bend]), law.K,
               np.concatenate([law.b, -high, -top]), law.d, (*law.activations, *(ReLU(),) * (2 * l)))
