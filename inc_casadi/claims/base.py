"""What a claim promises: a statement about the loop that follows from matrix inequalities."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from ..brief import Brief
from ..inc import INC
from ..loop import ClosedLoop
from ..multipliers.base import Multiplier, Unknown
from ..plant import Plant

Graphs = Mapping[str, ClosedLoop]
"""The loops that a claim's inequalities are written over, by name; each has a multiplier of its own."""

DECREASE, POSITIVE = "decrease", "positive"


class Claim(Brief, ABC):
    """A statement about every motion of a loop, with the matrix inequalities that it follows from.

    The theorem behind a claim reads: if the controller is well posed, the multiplier is sound (`Multiplier`), `obstacle`
    names nothing, and every matrix of `conditions` is positive definite, then `sentence` is true. The inequalities are
    written with `@ + - * .T` and `blocks` only, so CVXPY, NumPy, CasADi, exact arithmetic and the solvers' `Affine` all
    read the same text.
    """

    @abstractmethod
    def check(self, plant: Plant, inc: INC) -> None:
        """Raise an INCError when the claim does not make sense for this plant and controller."""

    def refusal(self, loop: ClosedLoop, multiplier: Multiplier) -> str | None:
        """Return why the claim cannot be proved with this multiplier, or None."""
        return multiplier.refusal(loop)

    def graphs(self, loop: ClosedLoop, multiplier: Multiplier) -> dict[str, ClosedLoop]:
        """Return the loops to write inequalities over, in the arithmetic of `loop`."""
        now = multiplier.now(loop)
        return {DECREASE: multiplier.step(loop), **({} if now is None else {POSITIVE: now})}

    @abstractmethod
    def unknowns(self, graphs: Graphs) -> tuple[Unknown, ...]:
        """Return the numbers to look for, the multipliers' apart."""

    @abstractmethod
    def conditions(self, graphs: Graphs, values: Mapping[str, Any], M: Mapping[str, Any]) -> dict[str, Any]:
        """Return the named symmetric matrices that must be positive definite; M holds each graph's multiplier matrix."""

    def objective(self, graphs: Graphs, values: Mapping[str, Any]) -> Any:
        """Return what to minimize, a 1 x 1 matrix linear in the values, or None when any solution will do."""
        return None

    @abstractmethod
    def bound(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return the number that the claim states."""

    @abstractmethod
    def merit(self, loop: ClosedLoop, values: Mapping[str, Any]) -> float:
        """Return how strong the statement is, to compare certificates of one claim: larger is stronger."""

    @abstractmethod
    def sentence(self, loop: ClosedLoop, values: Mapping[str, Any]) -> str:
        """Return what is proved, in one sentence for an engineer."""

    @property
    def yes_or_no(self) -> bool:
        """Whether the claim is the same whatever numbers prove it, so that there is nothing to improve."""
        return False

    @property
    def compound(self) -> bool:
        """Whether the claim has more than one step, of several plants or several claims."""
        return False

    @property
    def uncertain(self) -> bool:
        """Whether the claim is about a family of plants already, whose signal w it takes from the stack."""
        return False

    @property
    def sums(self) -> bool:
        """Whether the proof adds up its inequality over time with weights that do not grow; a named rate's do."""
        return True

    @property
    def tunable(self) -> bool:
        """Whether a level is left open, for the search to make as strong as it can."""
        return False

    def at(self, level: float, loop: ClosedLoop) -> Claim:
        """Return the claim with its level fixed; the larger the stronger, and 0 is what is claimed without one."""
        raise NotImplementedError

    def ceiling(self, loop: ClosedLoop) -> float:
        """Return a level that no certificate can reach."""
        raise NotImplementedError

    def growth(self, discrete: bool) -> float | None:
        """Return what motions may grow by at most while the claim is true, or None where that is not about the plant alone.

        A factor per step, or a rate in 1/s in continuous time: 1 or 0 for whatever makes motions converge.
        """
        return None if self.uncertain or self.compound else 1.0 if discrete else 0.0

    def obstacle(self, plant: Plant, inc: INC, *, exactly: bool = False) -> str | None:
        """Return why the claim would not follow from its conditions, or None; `exactly` allows no tolerance."""
        return None


def storage(graphs: Graphs) -> Unknown:
    """Return P, the matrix of the Lyapunov function."""
    size = graphs[DECREASE].X.shape[0]
    return Unknown("P", (size, size), "symmetric")


def positive(graphs: Graphs, P: Any, M: Mapping[str, Any]) -> dict[str, Any]:
    """Return the condition that V(x) > 0 for x != 0: P > 0, or P > 0 on the graph when V depends on hidden vectors."""
    if POSITIVE not in graphs:
        return {"P": P}
    rows = graphs[POSITIVE].X
    return {"P": rows.T @ P @ rows - M[POSITIVE]}


def descent(step: ClosedLoop, P: Any, discount: Any = None) -> Any:
    """Return V - discount V+ over s in discrete time (discount None: 1), or -dV/dt in continuous time."""
    X, F = step.X, step.F
    if step.plant.discrete:
        ahead = F.T @ P @ F
        return X.T @ P @ X - (ahead if discount is None else discount * ahead)
    flow = X.T @ P @ F
    return -(flow + flow.T)


def storage_form(loop: ClosedLoop, values: Mapping[str, Any]) -> str:
    """Return the Lyapunov function in words."""
    x = "x" if loop.inc.preserves_origin else "(x - x*)"
    if values["P"].shape[0] == loop.n:
        return f"{x}'P {x}"
    return "v'P v (v: the state and hidden vectors" + ("" if x == "x" else ", less their rest values") + ")"
