"""A law planned for evaluation: its stages, how each loop is solved, and bounds on everything that is formed."""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import InvalidInputError
from ...inc import INC
from ...sets import Box
from .choice import chosen
from .loops import Loop, after_contraction, contracting, tested
from .precision import DOUBLE, Precision, check_coefficients
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
    def precision(self) -> Precision:
        """The floats that are computed with."""
        return self.sizes.precision

    @property
    def keeps_patterns(self) -> bool:
        """Whether some loop takes Newton's trials."""
        return any(loop is not None and loop.trials for loop in self.loops)


def planned(inc: INC, method: str, tol: float, cache: bool, inputs: Box | None, limits: Box | None,
            precision: Precision = DOUBLE) -> Plan:
    """Return the plan of a law; see `generate.to_c` for the arguments and for what is refused.

    >>> from inc_casadi import INC
    >>> [loop.method for loop in planned(INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), "newton", 1e-12, False, None, None).loops]
    ['newton']
    """
    law, stages = arranged(inc)
    sizes = begin(law, inputs, precision)
    loops: list[Loop | None] = []
    for stage in stages:
        if not stage.loop:
            sizes = layer(law, stage, sizes)
            loops.append(None)
            continue
        if method == "one pass":
            raise InvalidInputError(f"method is 'one pass', but {stage.size} hidden units form a loop in W")
        loop, sizes = _solved(law, stage, sizes, method, tol, cache, inputs)
        loops.append(loop)
    check_coefficients(law, [loop.weights for loop in loops if loop is not None], precision)
    plan = Plan(law, stages, tuple(loops), sizes, tol, cache, limits)
    if cache and not plan.keeps_patterns:
        raise InvalidInputError("cache keeps the pattern of a loop that Newton's trials solve, but this law has none")
    return plan


def _solved(law: INC, stage: Stage, sizes: Sizes, method: str, tol: float, cache: bool,
            inputs: Box | None) -> tuple[Loop, Sizes]:
    """How one loop is solved, and the bounds after it.

    The number of steps is monotone in tol and, for W = kappa W0, in kappa, as long as the proof is of one kind; where a
    contraction ends and a multiplier T takes over it falls. Neither number can be mended: that of the contraction, about
    log(1 / tol) / (1 - rate), is attained by units that push each other up, and holds in floats, where it ends within its
    error whether or not the test is passed. A contracting loop has a multiplier too, and splitting by it would promise about
    log(1 / tol) / sqrt(1 - rate) steps; but in exact arithmetic only: in floats such a loop with rate 0.999 missed its
    tolerance at one measurement in six. So a contraction is taken wherever there is one.
    """
    test = tested(law, stage)
    way = chosen(law, stage, test, method, tol, cache, inputs)
    if test.contracts:
        loop = contracting(law, stage, test, sizes, tol, way)
        return loop, after_contraction(law, stage, loop, test, sizes, tol)
    loop = splitting(law, stage, test, tol, way.newton)
    return loop, after_splitting(law, stage, test, sizes, tol)
