"""A law planned for evaluation: its stages, how each loop is solved, and bounds on everything that is formed."""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import InvalidInputError
from ...inc import INC
from ...sets import Box
from .choice import chosen
from .loops import Loop, after_contraction, contracting, tested
from .sizes import Sizes, begin, layer
from .split_loops import after_splitting, splitting
from .stages import Stage, arranged


@dataclass(frozen=True, eq=False)
class Plan:
    """A law in order of evaluation: its stages, how each loop is solved (None for a layer), and bounds on all it forms."""

    law: INC
    stages: tuple[Stage, ...]
    loops: tuple[Loop | None, ...]
    sizes: Sizes
    tol: float
    cache: bool
    limits: Box | None

    @property
    def keeps_patterns(self) -> bool:
        """Whether some loop takes Newton's trials."""
        return any(loop is not None and loop.trials for loop in self.loops)


def planned(inc: INC, method: str, tol: float, cache: bool, inputs: Box | None, limits: Box | None) -> Plan:
    """Return the plan of a law; see `generate.to_c` for the arguments and for what is refused.

    >>> from inc_casadi import INC
    >>> [loop.method for loop in planned(INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), "newton", 1e-12, False, None, None).loops]
    ['newton']
    """
    law, stages = arranged(inc)
    sizes = begin(law, inputs)
    loops: list[Loop | None] = []
    for stage in stages:
        if not stage.loop:
            sizes = layer(law, stage, sizes)
            loops.append(None)
            continue
        if method == "one pass":
            raise InvalidInputError(f"method is 'one pass', but {stage.size} hidden units form a loop in W")
        test = tested(law, stage)
        newton = chosen(law, stage, test, method, tol, cache, inputs)
        if test.contracts:
            loop = contracting(law, stage, test, sizes, tol, newton)
            sizes = after_contraction(law, stage, loop, test, sizes, tol)
        else:
            loop = splitting(law, stage, test, tol, newton)
            sizes = after_splitting(law, stage, test, sizes, tol)
        loops.append(loop)
    plan = Plan(law, stages, tuple(loops), sizes, tol, cache, limits)
    if cache and not plan.keeps_patterns:
        raise InvalidInputError("cache keeps the pattern of a loop that Newton's trials solve, but this law has none")
    return plan
