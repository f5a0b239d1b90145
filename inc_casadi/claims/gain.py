"""The l2 gain from a disturbance to a performance output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, matrix, number
from ..blocks import diag
from ..errors import DimensionError
from ..figures import at_most
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Multiplier, Unknown, constant
from ..plant import Plant
from .base import DECREASE, Claim, Graphs, descent, positive, storage


@dataclass(frozen=True, eq=False)
class L2Gain(Claim):
    """The energy of an output is at most gain^2 times that of a disturbance. Sufficient, not necessary.

    x+ (or dx/dt) = A x + B u + E w,  y = C x + D w,  e = C_e x + D_u u + D_w w. If V = x'P x > 0 and

        V - V+ (or -dV/dt) - e'e + gain^2 w'w - s'M s > 0     for s = (x, eta, w) != 0,

    then sum |e_k|^2 (or the integral of |e|^2) <= V(x_0) + gain^2 sum |w_k|^2 for every w, by summation (the bounded real
    lemma with a multiplier: Boyd et al., Linear Matrix Inequalities in System and Control Theory, 1994, sec. 8.1); with
    w = 0 the loop is globally exponentially stable. For a biased loop s is the difference of two motions, and the statement
    is about differences: the incremental gain.

    E (n, r); C_e (l, n), the identity when left out; D_u (l, m), D_w (l, r), D (p, r), zero when left out; gain: what to
    prove, or None for the smallest that is found.

    Raises DimensionError, InvalidInputError.

    >>> L2Gain([[1.0]], gain=2.0).gain
    2.0
    """

    E: Array
    C_e: Array | None = None
    D_u: Array | None = None
    D_w: Array | None = None
    D: Array | None = None
    gain: float | None = None

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, E: ArrayLike, C_e: ArrayLike | None = None, D_u: ArrayLike | None = None,
                     D_w: ArrayLike | None = None, D: ArrayLike | None = None, gain: float | None = None) -> None: ...

    def __post_init__(self) -> None:
        for name in ("E", "C_e", "D_u", "D_w", "D"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, matrix(name, getattr(self, name)))
        if self.gain is not None:
            object.__setattr__(self, "gain", number("gain", self.gain, 0.0, open_low=True))

    def check(self, plant: Plant, inc: INC) -> None:
        """Raise DimensionError when a matrix does not fit the plant."""
        r, l = self.E.shape[1], plant.n if self.C_e is None else self.C_e.shape[0]
        for name, shape in (("E", (plant.n, r)), ("C_e", (l, plant.n)), ("D_u", (l, plant.m)), ("D_w", (l, r)),
                            ("D", (plant.p, r))):
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise DimensionError(f"{name} has shape {value.shape}, but with {plant.n} states, {plant.m} inputs, "
                                     f"{plant.p} measurements, {r} disturbances and {l} outputs it must be {shape}")

    def refusal(self, loop: ClosedLoop, multiplier: Multiplier) -> str | None:
        """Return why the multiplier does not apply to the loop with its disturbance."""
        loop = loop.with_inputs(self.E, self.D)
        refusal = multiplier.refusal(loop)
        if refusal is None and multiplier.step(loop).about != loop.about:
            return ("the controller is biased, so its gain is incremental and compares two motions, but the "
                    f"{multiplier.name} multiplier speaks of deviations from an equilibrium")
        return refusal

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return the stacks with w in them."""
        return super().graphs(loop.with_inputs(self.E, self.D), multiplier)

    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return P and, when it is to be found, gain^2 (1,)."""
        return (storage(graphs), *(() if self.gain is not None else (Unknown("gain^2", (1,), "nonnegative"),)))

    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return V > 0 and the dissipation, over the stack."""
        P, step = values["P"], graphs[DECREASE]
        w = disturbance_rows(step, self.E.shape[1])
        e = self._output(step, w)
        if self.gain is None:
            level = _times_identity(w, values["gain^2"])
        else:
            gain = constant(step, self.gain)
            level = (gain * gain) * (w.T @ constant(step, np.eye(len(w))) @ w)
        return {**positive(graphs, P, M), "decrease": descent(step, P) - e.T @ e + level - M[DECREASE]}

    def objective(self, graphs: Graphs, values: Mapping[str, Any]) -> Any:
        """Return gain^2 as a 1 x 1 matrix, or None when the gain is given."""
        return None if self.gain is not None else diag(values["gain^2"])

    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the gain, rounded up."""
        if self.gain is not None:
            return self.gain
        return float(np.nextafter(np.sqrt(max(float(values["gain^2"][0]), 0.0)), np.inf))

    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return minus the gain."""
        return -self.bound(loop, values)

    @property
    def yes_or_no(self) -> bool:
        """Whether a gain was asked for."""
        return self.gain is not None

    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return the promise with its gain."""
        gain = at_most(self.bound(loop, values))
        if loop.inc.preserves_origin:
            return (f"The l2 gain from the disturbance w to the output e is at most {gain}: from x0 = 0 the energy of e is "
                    f"at most {gain}^2 times that of w, and without w the origin is globally exponentially stable.")
        return (f"The incremental l2 gain from the disturbance w to the output e is at most {gain}: for any two motions "
                f"from one x0 the energy of the difference of e is at most {gain}^2 times that of the difference of w.")

    def _output(self, step: ClosedLoop, w: Array) -> Any:
        """Return the rows of e over the stack."""
        x = step.X[: step.n, :]
        e = x if self.C_e is None else constant(step, self.C_e) @ x
        if self.D_u is not None:
            e = e + constant(step, self.D_u) @ step.G
        return e if self.D_w is None else e + constant(step, self.D_w) @ w


def disturbance_rows(step: ClosedLoop, r: int) -> Array:
    """Return the rows of s that are w (r, width), the last of the columns that enter from outside."""
    start = step.n + step.q + step.inputs - r
    return np.eye(step.width)[start: start + r]


def _times_identity(rows: Array, number: Any) -> Any:
    """Return number rows'rows for a number in a vector of one, of any kind."""
    return sum((row[:, None] @ diag(number) @ row[None, :] for row in rows[1:]), start=rows[0][:, None] @ diag(number)
               @ rows[0][None, :])
