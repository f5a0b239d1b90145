"""What a multiplier promises: a quadratic form in s that is nonnegative wherever eta = phi(Z s)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..brief import Brief
from ..errors import InvalidInputError
from ..loop import ClosedLoop
from ..readings import Reading

KINDS = ("symmetric", "nonnegative", "free", "symmetric_nonnegative")


@dataclass(frozen=True, eq=False)
class Unknown(Brief):
    """A matrix or vector that a solver looks for.

    kind: "symmetric"; "nonnegative", entry by entry; "free"; "symmetric_nonnegative", both. Positive definiteness is no
    kind: it is a condition of the claim. zero: True where the entry is fixed at 0; unsigned: True where it may be negative
    all the same; both (in the unknown's shape) or None for nowhere.

    >>> Unknown("Lambda", (2,), "nonnegative").signed.tolist()
    [True, True]
    """

    name: str
    shape: tuple[int, ...]
    kind: str
    zero: Array | None = None
    unsigned: Array | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InvalidInputError(f"unknown {self.name} is of kind {self.kind!r}, not one of {', '.join(KINDS)}")

    @property
    def is_symmetric(self) -> bool:
        """Whether the matrix equals its transpose."""
        return self.kind.startswith("symmetric")

    @property
    def free(self) -> np.ndarray:
        """True (in the unknown's shape) where the entry is not fixed at zero."""
        return np.ones(self.shape, dtype=bool) if self.zero is None else ~self.zero

    @property
    def signed(self) -> np.ndarray:
        """True (in the unknown's shape) where the entry must be nonnegative."""
        mask = np.full(self.shape, self.kind.endswith("nonnegative")) & self.free
        return mask if self.unsigned is None else mask & ~self.unsigned


class Multiplier(ABC):
    """A family of matrices M with s'M s >= 0 for every s on the graph eta = phi(Z s), about the loop's center.

    Built from what the activations state (slopes, sector, odd, pieces), never from their names. What s is deviation from
    is `loop.about`: the origin, an equilibrium, or another motion; facts that need more than the loop offers are left out.
    The theorem behind a multiplier: if every `Unknown.signed` entry and every entry of `signs` is nonnegative, then
    s'M s >= 0 on the graph.
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """The word that selects the multiplier in `certify`."""

    @property
    def steps(self) -> int:
        """How many future hidden vectors the Lyapunov function's difference involves: 0 when V depends on x alone."""
        return 0

    @abstractmethod
    def refusal(self, loop: ClosedLoop) -> str | None:
        """Return why the multiplier does not apply to the loop, or None when it does."""

    @abstractmethod
    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return the numbers to look for, on a widened loop."""

    @abstractmethod
    def matrix(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return M, of the width of the (widened) loop, of the kind of the values and of the loop's matrices."""

    def signs(self, loop: ClosedLoop, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return named matrices, linear in the values, whose entries must be nonnegative besides those of `unknowns`."""
        return {}

    def widened(self, loop: ClosedLoop) -> ClosedLoop:
        """Return the loop with the further columns of s that the multiplier speaks of."""
        return loop

    def step(self, loop: ClosedLoop) -> ClosedLoop:
        """Return the loop whose rows X and F are what the Lyapunov function is quadratic in, now and one step on."""
        return self.widened(loop)

    def now(self, loop: ClosedLoop) -> ClosedLoop | None:
        """Return the loop over what the Lyapunov function is quadratic in, or None when that is x alone."""
        return None


def constant(loop: ClosedLoop, value: Any) -> Any:
    """Return a number or array as the kind that the loop is read with, so that arithmetic on it is not rounded.

    Fractions are rounded once, with that rounding accounted for, where the loop is read in floats. Needed for arithmetic
    between constants (a square of a rate, say): products of floats with the loop's matrices lift by themselves.
    """
    if isinstance(loop.F, Reading):
        return loop.F.lift(value)
    if isinstance(loop.F, np.ndarray) and loop.F.dtype == object:
        return exact(value)
    return np.asarray(value, dtype=float) if isinstance(value, np.ndarray) and value.dtype == object else value
