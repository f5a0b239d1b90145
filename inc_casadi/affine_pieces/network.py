"""Units for maxima, minima and kinks: affine forms in the measurement and the units before, collected into an INC."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..activations import Activation, ReLU, Saturation
from ..arrays import Array
from ..inc import INC
from .expression import Expression, Gate


@dataclass(eq=False)
class Network:
    """Units as they are collected; a form (p + 1 + room,) is c = (a, e, v) with the value a'y + e + v'eta.

    p: how many measurements; room: how many units there may be. Each unit reads only those before it, so W is strictly
    lower triangular.
    """

    p: int
    room: int
    reads: list[Array] = field(default_factory=list)
    activations: list[Activation] = field(default_factory=list)

    def affine(self, gain: Array, offset: float) -> Array:
        """Return the form gain y + offset."""
        return np.concatenate([gain, [offset], np.zeros(self.room)])

    def unit(self, form: Array, activation: Activation) -> Array:
        """Add a unit that reads a form and return its value as a form."""
        self.reads.append(form)
        self.activations.append(activation)
        value = np.zeros_like(form)
        value[self.p + len(self.reads)] = 1.0
        return value

    def expression(self, wanted: Expression, gain: Array, offset: Array) -> Array:
        """Return the form of an expression of laws gain (L, p), offset (L,).

        max{r, s} = r + relu(s - r) and min{r, s} = r - relu(r - s): one unit each, and r goes on linearly. r is a law where
        possible, and constants come last: a value max{a, min{b, s}} is then within constants a and b in exact arithmetic,
        if b - a is a float. A part that occurs twice is made once.
        """
        done: dict[Gate, Array] = {}

        def value(part: Expression) -> Array:
            if not isinstance(part, Gate):
                return self.affine(gain[part], offset[part])
            if part not in done:
                done[part] = clip(part) if part.name == "clip" else fold(part)
            return done[part]

        def clip(gate: Gate) -> Array:
            low, high, rest = (value(part) for part in gate.parts)
            middle, half = (low + high) / 2, (high - low)[self.p] / 2
            middle[: self.p] = low[: self.p]  # the two laws differ by a constant
            return np.asarray(middle + half * self.unit((rest - middle) / half, Saturation()))

        def fold(gate: Gate) -> Array:
            parts = sorted(gate.parts, key=lambda part: 0 if isinstance(part, Gate) else 1 if gain[part].any() else 2)
            sign = 1.0 if gate.name == "max" else -1.0
            form = value(parts[0])
            for part in parts[1:]:
                other = value(part)
                form = other + sign * self.unit(sign * (form - other), ReLU())
            return form

        return value(wanted)

    def inc(self, outputs: Array) -> INC:
        """Return the INC whose outputs are forms (m, p + 1 + room)."""
        q, p = len(self.reads), self.p
        reads = np.array(self.reads).reshape(q, p + 1 + self.room) + 0.0  # no -0
        same = not self.activations or all(isinstance(each, ReLU) for each in self.activations)
        return INC(reads[:, p + 1: p + 1 + q], reads[:, :p], outputs[:, p + 1: p + 1 + q], outputs[:, :p], reads[:, p],
                   outputs[:, p], ReLU() if same else tuple(self.activations))
