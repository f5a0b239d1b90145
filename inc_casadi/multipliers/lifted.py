"""Lyapunov functions that are quadratic in the state and in hidden vectors: piecewise quadratic in the state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..arrays import number
from ..errors import InvalidInputError
from ..lifting import lifting_obstacle, unrolled
from ..loop import ClosedLoop
from .atoms import kinked_rows
from .base import Multiplier, Unknown
from .relu import Relu, about_rest
from .slope import Slope


@dataclass(frozen=True)
class Lifted(Multiplier):
    """V(x) = v'P v with v = (x, eta_0, ..., eta_{steps-1}), the hidden vectors of the next `steps` steps, discrete time.

    The inequalities that a claim states for x hold for v: V(x+) is the same form in v one step on, (x_1, eta_1, ...,
    eta_steps). Over the stack of all of them `Relu`, or `Slope` where no unit has a kink, speaks of every pair of hidden
    vectors, at one step or at two. P need not be positive definite, only V positive on the graph: P - M_positive > 0 over
    v, with a multiplier of its own. For piecewise-affine units steps = 1 contains the functions of Lur'e and Postnikov,
    whose integrals are then products (Park, IEEE TAC 47(2), 2002; Ahmad, Carrasco, Heath, IEEE TAC 60(1), 2015); for curved
    units the integrals are missing.

    With steps = 1 and no multiplier between them it is no weaker than `Relu`: P = blkdiag(P_x, 0), up to closure.

    Raises InvalidInputError for steps below 1.

    >>> Lifted(2).steps
    2
    """

    ahead: int = 1

    def __post_init__(self) -> None:
        if int(number("steps", self.ahead, 1)) != self.ahead:
            raise InvalidInputError(f"steps = {self.ahead} must be a whole number")
        object.__setattr__(self, "ahead", int(self.ahead))

    @property
    def name(self) -> str:
        """lifted, with the number of steps where it is not 1."""
        return "lifted" if self.ahead == 1 else f"lifted {self.ahead}"

    @property
    def steps(self) -> int:
        """How many hidden vectors V depends on."""
        return self.ahead

    def refusal(self, loop: ClosedLoop) -> str | None:
        """Return why there is nothing to lift, or why the inner multiplier does not apply."""
        if loop.q == 0:
            return "the loop has no hidden units to lift"
        if kinked_rows(loop) or loop.about != "origin":
            refusal = Relu().refusal(loop)
            if refusal:
                return refusal.replace("the relu multiplier needs", "the lifted multiplier of a biased loop needs")
            loop = about_rest(loop)
        return lifting_obstacle(loop, self.ahead)

    def unknowns(self, loop: ClosedLoop) -> tuple[Unknown, ...]:
        """Return the inner multiplier's unknowns over the stack."""
        return _inner(loop).unknowns(loop)

    def matrix(self, loop: ClosedLoop, values: Mapping[str, Any]) -> Any:
        """Return the inner multiplier's M over the stack."""
        return _inner(loop).matrix(loop, values)

    def signs(self, loop: ClosedLoop, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the inner multiplier's sign conditions."""
        return _inner(loop).signs(loop, values)

    def step(self, loop: ClosedLoop) -> ClosedLoop:
        """Return the loop over (x, eta_0, w, eta_1, ..., eta_steps) and the inner multiplier's columns."""
        return self._stack(loop, next_too=True)

    def now(self, loop: ClosedLoop) -> ClosedLoop:
        """Return the loop over v and the inner multiplier's columns."""
        return self._stack(loop, next_too=False)

    def _stack(self, loop: ClosedLoop, next_too: bool) -> ClosedLoop:
        loop = about_rest(loop)
        return _inner(loop).widened(unrolled(loop, self.ahead, next_too=next_too))


def _inner(loop: ClosedLoop) -> Multiplier:
    return Relu() if kinked_rows(loop) else Slope()
