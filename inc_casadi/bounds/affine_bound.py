"""The bound that affine moves give, with the numbers that prove it."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

from ..arrays import Array
from ..figures import at_least
from ..plant import Plant
from .affine_problem import Cuts
from .bound import Bound
from .exact_lagrangian import exact_lower
from .lagrangian import Lagrangian


@dataclass(frozen=True, eq=False)
class AffineMovesBound(Bound):
    """The bound of `affine_moves`, with the trial moves and multipliers that prove it.

    Parameters
    ----------
    moves : U (N, m, n + 1), the tangent point u_k = U_k [x_0; 1]
    cuts : constraints H[facet] u_move(point) <= h[facet] at initial states that may occur, c of them
    multipliers : (c,) >= 0 of the cuts
    anchors : (n, a) initial states that may occur and span all that do
    ties : (N, m, q) multipliers of what ties the moves of a time-invariant controller (`tied`), or None: the bound then
        covers controllers that vary with time as well
    relaxed : whether moves may depend on the full state though only y = C x is measured
    horizons : (N, value) of every horizon that was tried, for a plot; no part of the proof
    """

    moves: Array = field(repr=False)
    cuts: Cuts = field(repr=False)
    multipliers: Array = field(repr=False)
    anchors: Array = field(repr=False)
    relaxed: bool = False
    ties: Array | None = field(default=None, repr=False)
    horizons: tuple[tuple[int, float], ...] = field(default=(), repr=False)

    @property
    def statement(self) -> str:
        """One sentence for an engineer."""
        seen = "" if self.plant.full_state else ", whatever it measures" if self.relaxed else " that measures y = C x"
        N = len(self.moves)
        judged = "its first move" if N == 1 else f"its first {N} moves"
        kind, even = ("linear", ", even a time-varying one") if self.ties is None else ("linear time-invariant", "")
        return (f"Every {kind} controller of any finite order{seen}{even}, started from a fixed state and keeping the "
                f"input limits from every initial state, costs at least {at_least(self.value)} on average over the initial "
                f"states ({judged} counted).")

    @property
    def lagrangian(self) -> Lagrangian:
        """The Lagrangian at the stored numbers, for the measurements that the moves may use."""
        plant = seen_by_moves(self.plant, self.relaxed)
        return Lagrangian(plant, self.spec, self.moves, self.cuts, self.multipliers, self.anchors, self.ties)

    def dual(self) -> tuple[float, float]:
        """Return the Lagrangian, minimized over all moves within the limits, and its rounding allowance."""
        return self.lagrangian.lower()

    def exact_value(self) -> Fraction | str:
        """Return the Lagrangian's minimum in exact rational arithmetic (`exact_lower`), or in words why there is none."""
        return exact_lower(self.lagrangian)

    def holds(self) -> bool:
        """Return whether the stored numbers prove the value: NumPy only, no solver.

        The multipliers must be nonnegative, and the points of the cuts and the anchors initial states that may occur,
        which is decided exactly.
        """
        return not self.lagrangian.trouble and super().holds()


def seen_by_moves(plant: Plant, relaxed: bool) -> Plant:
    """Return the plant with the measurements that moves may use: all of the state when relaxed.

    >>> seen_by_moves(Plant([[0.5]], [[1.0]], C=[[2.0]]), True).full_state
    True
    """
    return Plant(plant.A, plant.B, dt=plant.dt) if relaxed else plant
