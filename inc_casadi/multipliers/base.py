"""What a multiplier promises: a quadratic form in s that is nonnegative wherever eta = phi(Z s)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..blocks import exact
from ..errors import InvalidInputError
from ..loop import ClosedLoop
from ..readings import Reading

KINDS = ("symmetric", "nonnegative", "free", "symmetric_nonnegative", "offdiagonal_nonnegative")


@dataclass(frozen=True)
class Unknown:
    """A matrix or vector that a solver looks for.

    kind: "symmetric"; "nonnegative", entry by entry; "free"; "symmetric_nonnegative", both;
    "offdiagonal_nonnegative", with a free diagonal. Positive definiteness is no kind: it is a condition of the claim.

    >>> Unknown("Lambda", (2,), "nonnegative").name
    'Lambda'
    """

    name: str
    shape: tuple[int, ...]
    kind: str

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InvalidInputError(f"unknown {self.name} is of kind {self.kind!r}, not one of {', '.join(KINDS)}")

    @property
    def is_symmetric(self) -> bool:
        """Whether the matrix equals its transpose."""
        return self.kind.startswith("symmetric")

    @property
    def signed(self) -> np.ndarray:
        """True (in the unknown's shape) where the entry must be nonnegative."""
        mask = np.full(self.shape, self.kind.endswith("nonnegative"))
        if self.kind == "offdiagonal_nonnegative":
            np.fill_diagonal(mask, False)
        return mask


class Multiplier(ABC):
    """A family of matrices M with s'M s >= 0 for every s = (x, eta) with eta = phi(Z s), about the loop's origin.

    Built from what the activations state (loop.lower, loop.upper, loop.cone), never from their names. For a
    biased loop s is the difference of two motions and the facts are those of slopes (thm:incremental_certificate).
    """

    @property
    @abstractmethod
    def name(self) -> str:
        """The word that selects the multiplier in `certify`."""

    @abstractmethod
    def refusal(self, loop: ClosedLoop) -> str | None:
        """Return why the multiplier does not apply to the loop, or None when it does."""

    @abstractmethod
    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return the numbers to look for."""

    @abstractmethod
    def matrix(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return M, (n+q, n+q), of the kind of the values and of the loop's matrices."""

    @abstractmethod
    def restored(self, loop: ClosedLoop, values: Mapping[str, Any], S: Array, sizes: Array) -> dict[str, Any]:
        """Return the values for this loop from those for its rescaled twin, in which a solver works.

        The twin has s = S s~, z = diag(sizes) z~ and eta = diag(sizes) eta~, sizes (q,) positive and S (n+q, n+q)
        invertible; with the returned values S'M S is the twin's M~.
        """


def constant(loop: ClosedLoop, value: Any) -> Any:
    """Return a number or array as the kind that the loop is read with, so that arithmetic on it is not rounded.

    Needed for arithmetic between constants only (a square of a rate, say): products with the loop's matrices lift by
    themselves, except in arrays of Fractions, where a bare float would spoil exactness.
    """
    if isinstance(loop.F, Reading):
        return loop.F.lift(value)
    if isinstance(loop.F, np.ndarray) and loop.F.dtype == object:
        return exact(value)
    return value
