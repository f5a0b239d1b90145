"""The extended plant, on which a controller with memory is a static law."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import DimensionError, InvalidInputError
from ..inc import INC
from ..linear.dynamic_loop import StartedFrom
from ..loop import fitting
from ..plant import Plant
from ..sets import Box, Polytope
from ..spec import Spec
from .controller import DynamicINC


def extended(plant: Any, dynamic: DynamicINC) -> tuple[Plant, INC]:
    """Return the plant with state (x, xi), input (u, v) and measurement (y, xi), and the static law that closes the loop.

    [x; xi]+ = [[A, 0], [0, 0]] [x; xi] + [[B, 0], [0, I]] [u; v] under (u, v) = law(y, xi). The motions of this loop from
    (x_0, xi_0) are those of plant and dynamic controller, and the stored numbers are only rearranged: a claim about the
    loop is one about the controller, to the bit.

    Parameters
    ----------
    plant : Plant or control.StateSpace, discrete time
    dynamic : DynamicINC that fits it

    Raises
    ------
    DimensionError : the numbers of inputs or measurements differ
    InvalidInputError : a continuous plant

    Examples
    --------
    >>> from inc_casadi import simulate
    >>> delay = DynamicINC(INC.linear([[-1.0, -0.5], [1.0, 0.0]]), [0.0])  # u_k = -y_k - 0.5 y_{k-1}
    >>> simulate(*extended(Plant(1.5, 1.0), delay), [1.0, 0.0], steps=3).x[0].tolist()
    [1.0, 0.5, -0.25, -0.375]
    """
    plant = _counting_steps(plant, dynamic)
    l = dynamic.order
    A, B, C = (blkdiag(part, beside) for part, beside in
               ((plant.A, np.zeros((l, l))), (plant.B, np.eye(l)), (plant.C, np.eye(l))))
    return Plant(A, B, C, plant.dt), dynamic.law


def extended_spec(spec: Spec, dynamic: DynamicINC, memory: Box | None = None) -> Spec:
    """Return the spec of the extended loop: Q of x alone, R of u alone, from (x_0, xi_0).

    J = E sum discount^k ([x; xi]'blkdiag(Q, 0) [x; xi] + [u; v]'blkdiag(R, 0) [u; v]) is the cost of plant and controller.
    The initial distribution is flat: xi_0 is fixed (`StartedFrom`).

    Parameters
    ----------
    spec : Spec of the plant
    dynamic : DynamicINC
    memory : Box in R^l that xi+ must stay in, which a Spec with input limits has to name: its sets are bounded. Claims
        certify it as they certify the limits of u. None only where `spec` has no input limits.

    Raises
    ------
    DimensionError : the spec is about another number of inputs, memory is not in R^l
    InvalidInputError : memory is missing

    Examples
    --------
    >>> delay = DynamicINC(INC.linear([[-1.0, -0.5], [1.0, 0.0]]), [0.0])
    >>> wide = extended_spec(Spec(Q=1.0, R=2.0, discount=0.9, initial=Box(-1, 1), inputs=Box(-3, 3)), delay, Box(-9, 9))
    >>> wide.R.tolist(), wide.inputs.upper.tolist(), wide.initial.vertices.tolist()
    ([[2.0, 0.0], [0.0, 0.0]], [3.0, 9.0], [[-1.0, 1.0], [0.0, 0.0]])
    """
    if spec.m != dynamic.m:
        raise DimensionError(f"the spec is about {spec.m} inputs, but the controller sets {dynamic.m}")
    l = dynamic.order
    nothing = np.zeros((l, l))
    inputs = None if spec.inputs is None else beside(spec.inputs, _checked(memory, l))
    return Spec(blkdiag(spec.Q, nothing), blkdiag(spec.R, nothing), spec.discount, StartedFrom(spec.initial, dynamic.xi_0),
                inputs)


def beside(first: Box | Polytope, second: Box) -> Box | Polytope:
    """Return the product of two sets.

    >>> beside(Box([-1], [1]), Box([0], [2])).upper.tolist()
    [1.0, 2.0]
    """
    if isinstance(first, Box):
        return Box(np.concatenate([first.lower, second.lower]), np.concatenate([first.upper, second.upper]))
    return Polytope(blkdiag(first.H, second.H), np.concatenate([first.h, second.h]))


def blkdiag(first: Array, second: Array) -> Array:
    """Return [[first, 0], [0, second]].

    >>> blkdiag(np.ones((1, 2)), np.ones((1, 1))).tolist()
    [[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    return np.block([[first, np.zeros((len(first), second.shape[1]))], [np.zeros((len(second), first.shape[1])), second]])


def _checked(memory: Box | None, l: int) -> Box:
    if memory is None:
        raise InvalidInputError("memory is missing: with input limits the set of (u, xi+) must be bounded, so name a Box "
                                "that xi+ stays in; it is certified along with the limits")
    if memory.dimension != l:
        raise DimensionError(f"memory is a box in R^{memory.dimension}, but the controller has order {l}")
    return memory


def _counting_steps(plant: Any, dynamic: DynamicINC) -> Plant:
    if not isinstance(dynamic, DynamicINC):
        raise InvalidInputError(f"dynamic must be a DynamicINC, not {type(dynamic).__name__}")
    plant = fitting(plant, dynamic)
    if not plant.discrete:
        raise InvalidInputError("the controller counts steps, but the plant is continuous (dt = 0): use plant.sampled(dt)")
    return plant
