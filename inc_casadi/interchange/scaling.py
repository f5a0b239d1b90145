"""A controller that was trained on normalized data, as one in the units of plant and actuator."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, vector
from ..errors import InvalidInputError
from ..inc import INC

Scaling = tuple[ArrayLike, ArrayLike]
"""Mean and standard deviation, each one number or one per entry: what is normalized is (value - mean) / std."""


def scaled(inc: INC, inputs: Scaling | None = None, outputs: Scaling | None = None) -> INC:
    """Return the law u = mean_u + std_u inc((y - mean_y) / std_y), entry by entry; what is left out is not scaled.

    With M = diag(1 / std_y) and S = diag(std_u) it has U M, b - U M mean_y, S V, S K M and S (d - K M mean_y) + mean_u: the
    same units, so that well-posedness is that of `inc`.

    Parameters
    ----------
    inputs : (mean, std) of the measurements, in their units, std positive
    outputs : (mean, std) of the outputs in the units of the actuator; std may be negative, but not zero

    Raises
    ------
    DimensionError : as many numbers as entries, or one, are needed
    InvalidInputError : a std that is not positive, or zero

    >>> net = INC.from_layers([([[1.0]], [0.0]), ([[1.0]], [0.0])])
    >>> scaled(net, (10.0, 2.0), (5.0, 3.0))([[8.0, 14.0]]).tolist()
    [[5.0, 11.0]]
    """
    mean_y, std_y = _parts("input", inputs, inc.p)
    mean_u, std_u = _parts("output", outputs, inc.m)
    if np.any(std_y <= 0):
        raise InvalidInputError(f"the std of the input scaling must be positive, but its smallest entry is {std_y.min():g}")
    if np.any(std_u == 0):
        raise InvalidInputError("the std of the output scaling has a zero: that output would be constant")
    U, K = inc.U / std_y, inc.K / std_y
    return INC(inc.W, U, std_u[:, None] * inc.V, std_u[:, None] * K, inc.b - U @ mean_y,
               std_u * (inc.d - K @ mean_y) + mean_u, inc.activations)


def _parts(name: str, scaling: Scaling | None, size: int) -> tuple[Array, Array]:
    if scaling is None:
        return np.zeros(size), np.ones(size)
    if not isinstance(scaling, tuple | list) or len(scaling) != 2:
        raise InvalidInputError(f"the {name} scaling must be a pair (mean, std), not {scaling!r}")
    mean, std = scaling
    return _spread(f"mean of the {name} scaling", mean, size), _spread(f"std of the {name} scaling", std, size)


def _spread(name: str, value: ArrayLike, size: int) -> Array:
    return np.repeat(vector(name, value), size) if np.size(value) == 1 else vector(name, value, size)
