"""Controllers for python-control, and gains from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import matrix
from ..errors import InvalidInputError, SolverError
from ..inc import INC
from ..sets import Box


def to_control(inc: INC, dt: float | bool | None = None, *, name: str = "inc", inputs: Sequence[str] | None = None,
               outputs: Sequence[str] | None = None) -> Any:
    """Return an INC as a static `control.NonlinearIOSystem` from y to u, for `control.interconnect` and simulation.

    The feedback is u = inc(y) as it stands, with no sign added: interconnect it without a minus.

    Parameters
    ----------
    inc : INC with p measurements and m outputs
    dt : time base as in python-control; None fits every plant, 0 is continuous time
    name : of the system
    inputs, outputs : signal names, y[0], y[1], ... and u[0], u[1], ... when left out

    Raises
    ------
    InvalidInputError : not an INC, or as many names as signals are needed
    SolverError : python-control is not installed
    NotWellPosedError : the fixed point is not proved unique

    Examples
    --------
    >>> system = to_control(INC.saturated([[2.0, 0.0]], 1.0), dt=0.1)
    >>> system.output(0, [], [3.0, 0.0]).tolist(), system.input_labels
    ([1.0], ['y[0]', 'y[1]'])
    """
    if not isinstance(inc, INC):
        raise InvalidInputError(f"inc must be an INC, not {type(inc).__name__}")
    try:
        import control
    except ImportError as error:
        raise SolverError("to_control needs python-control: pip install control") from error
    inc(np.zeros(inc.p))  # refuse here, by name, what cannot be evaluated

    def answer(t: float, x: Any, y: Any, parameters: Any) -> Any:
        return inc(np.asarray(y, dtype=float))

    return control.NonlinearIOSystem(None, answer, inputs=_labels("inputs", inputs, "y", inc.p),
                                     outputs=_labels("outputs", outputs, "u", inc.m), dt=dt, name=name)


def from_lqr(gain: Any, limits: Box | None = None) -> INC:
    """Return the law u = -K x of `control.lqr` or `control.dlqr`, clipped to limits where they are given.

    python-control states gains for u = -K x, this toolbox for u = K y: the sign is turned here, once.

    Parameters
    ----------
    gain : K (m, n), or the tuple (K, S, E) that lqr and dlqr return
    limits : Box in R^m

    Raises
    ------
    InvalidInputError, DimensionError : no matrix, or limits that do not fit

    Examples
    --------
    >>> import control
    >>> law = from_lqr(control.dlqr([[1.2]], [[1.0]], [[1.0]], [[1.0]]), Box([-1.0], [1.0]))
    >>> law([[0.5, 3.0]]).round(4).tolist()
    [[-0.3968, -1.0]]
    """
    K = gain[0] if isinstance(gain, tuple) else gain
    law = INC.linear(-matrix("K", K) + 0.0)  # + 0.0: no negative zeros
    return law if limits is None else law.with_saturated_output(limits)


def _labels(what: str, given: Sequence[str] | None, letter: str, size: int) -> list[str]:
    labels = [f"{letter}[{i}]" for i in range(size)] if given is None else list(given)
    if len(labels) != size:
        raise InvalidInputError(f"{what} names {len(labels)} signals, but the controller has {size}")
    return labels
