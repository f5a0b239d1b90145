"""Put the input limits into a law, take them out again, and give it more hidden units: always the same law within limits."""

from __future__ import annotations

import numpy as np

from inc_casadi import INC, Box, Saturation, Spec
from inc_casadi.output_range import within_limits


def built_in(inc: INC, spec: Spec) -> bool:
    """Whether no output of the law can leave the input limits, whatever it measures."""
    return spec.inputs is None or within_limits(inc, spec.inputs)


def limited(inner: INC, spec: Spec) -> INC:
    """Return the law with the input limits built in, where they are a box and are not built in already."""
    if not isinstance(spec.inputs, Box) or built_in(inner, spec):
        return inner
    return inner.with_saturated_output(spec.inputs)


def inner_of(inc: INC, spec: Spec) -> INC:
    """Return the law without a saturated readout that `INC.with_saturated_output` built: v where u = clip(v).

    A law of another form is returned as it is.

    >>> law = INC.linear([[-2.0]]).with_saturated_output(Box([-1.0], [1.0]))
    >>> inner_of(law, Spec([[1.0]], [[1.0]], 1.0, Box([-1.0], [1.0]), Box([-1.0], [1.0]))).K.tolist()
    [[-2.0]]
    """
    if not has_readout(inc) or spec.inputs is None:
        return inc
    q = inc.q - inc.m
    half = np.diag(inc.V[:, q:])[:, None]
    return INC(inc.W[:q, :q], inc.U[:q], half * inc.W[q:, :q], half * inc.U[q:], inc.b[:q],
               half[:, 0] * inc.b[q:] + inc.d, inc.activations[:q])


def has_readout(inc: INC) -> bool:
    """Whether the law ends in one saturation unit per output that only the outputs read."""
    q = inc.q - inc.m
    if q < 0 or inc.K.any() or inc.V[:, :q].any() or inc.W[:, q:].any():
        return False
    last = inc.V[:, q:]
    return np.array_equal(last, np.diag(np.diag(last))) and bool(np.all(np.diag(last) > 0)) and all(
        isinstance(unit, Saturation) for unit in inc.activations[q:])


def wider(inner: INC, idle: INC) -> INC:
    """Return the law with the hidden units of another beside its own, read by nobody yet: the same law, room to train.

    >>> wider(INC.linear([[1.0]]), INC([[0.5]], [[1.0]], [[2.0]], [[3.0]])).V.tolist()
    [[0.0]]
    """
    zero = np.zeros((inner.q, idle.q))
    return INC(np.block([[inner.W, zero], [zero.T, idle.W]]), np.vstack([inner.U, idle.U]),
               np.hstack([inner.V, np.zeros((inner.m, idle.q))]), inner.K, np.concatenate([inner.b, idle.b]), inner.d,
               inner.activations + idle.activations)
