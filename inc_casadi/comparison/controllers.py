"""Controllers as they are given: checked at the door, and judged by what they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from ..arrays import Array, matrix
from ..brief import Brief
from ..dynamic import DynamicINC
from ..errors import DimensionError, INCError, InvalidInputError
from ..inc import INC
from ..linear.controller import LinearController
from ..linear.linear_cost import LinearCost
from ..linear.static_gain import StaticGain
from ..plant import Plant
from ..spec import Spec
from .dynamic_laws import judge_dynamic
from .effort import Effort
from .laws import judge_law
from .linear_laws import judge_linear
from .row import Row
from .simulated import judge_callable

Judge = Callable[[Plant, Spec, str, Any, Effort], Row]
_USERS = (INCError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)  # what a law of the user may raise


@dataclass(frozen=True, eq=False)
class CallableLaw(Brief):
    """A law y -> u of which nothing is known but its answers: columns (p, N) to columns (m, N).

    Raises
    ------
    InvalidInputError, DimensionError : when asked and the function fails or answers in another shape

    >>> CallableLaw("half", lambda y: 0.5 * y, 1)(np.ones((1, 2))).tolist()
    [[0.5, 0.5]]
    """

    name: str
    law: Callable[[Array], Any]
    m: int

    def __call__(self, y: Array) -> Array:
        try:
            u = np.asarray(self.law(y), dtype=float)
        except _USERS as error:
            raise InvalidInputError(f"controller {self.name!r} fails on measurements of shape {y.shape}: "
                                    f"{type(error).__name__}: {error}") from error
        if u.shape != (self.m, y.shape[1]):
            raise DimensionError(f"controller {self.name!r} answers measurements of shape {y.shape} with inputs of shape "
                                 f"{u.shape}, but must answer with {(self.m, y.shape[1])}")
        return u


def admitted(plant: Plant, spec: Spec, controllers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the controllers by name, each an INC, a DynamicINC, a linear controller or a CallableLaw that fits the plant.

    A gain F (m, p), or a StaticGain, becomes the law u = F y; a LinearCost stands for its controller.

    Raises
    ------
    InvalidInputError, DimensionError : naming the controller that is none or does not fit

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-1, 1))
    >>> admitted(Plant(1.5, 1.0), spec, {"deadbeat": [[-1.5]]})["deadbeat"]([2.0]).tolist()
    [-3.0]
    """
    if not isinstance(controllers, Mapping):
        raise InvalidInputError(f"controllers must map names to controllers, but is {type(controllers).__name__}")
    return {_name(name): _admitted(plant, spec, name, given) for name, given in controllers.items()}


def judge(plant: Plant, spec: Spec, name: str, controller: Any, effort: Effort) -> Row:
    """Return the row of an admitted controller; a failure is a row with its reason.

    >>> from inc_casadi import Box
    >>> spec = Spec(1.0, 0.0, 0.9, Box(-1, 1))
    >>> judge(Plant(1.5, 1.0), spec, "lost", "no gain was found", Effort()).notes
    ('no gain was found',)
    """
    begun = perf_counter()
    if isinstance(controller, str):
        return Row(name, None, "not found", notes=(controller,))
    try:
        row = _judge_of(controller)(plant, spec, name, controller, effort)
    except INCError as error:
        row = Row(name, controller, type(controller).__name__, notes=(str(error),))
    return replace(row, seconds=perf_counter() - begun)


_JUDGES: tuple[tuple[type, Judge], ...] = ((INC, judge_law), (LinearController, judge_linear), (DynamicINC, judge_dynamic),
                                           (CallableLaw, judge_callable))


def _judge_of(controller: Any) -> Judge:
    return next(judge for kind, judge in _JUDGES if isinstance(controller, kind))


def _name(name: Any) -> str:
    if not isinstance(name, str) or not name:
        raise InvalidInputError(f"controllers has the name {name!r}, but names are words")
    return name


def _admitted(plant: Plant, spec: Spec, name: str, given: Any) -> Any:
    if isinstance(given, StaticGain | LinearCost):
        given = given.F if isinstance(given, StaticGain) else given.controller
    if isinstance(given, tuple(kind for kind, _ in _JUDGES)):
        return _fitting(plant, name, given)
    if callable(given):
        law = CallableLaw(name, given, plant.m)
        law(plant.C @ spec.initial.sample(3, np.random.default_rng(0)))
        return law
    if given is None or isinstance(given, str | Mapping):
        raise InvalidInputError(f"controller {name!r} is {given!r}, but must be an INC, a gain matrix (m, p), a "
                                "LinearController, a DynamicINC or a function of y")
    return INC.linear(matrix(f"controller {name!r}", given, (plant.m, plant.p)))


def _fitting(plant: Plant, name: str, given: Any) -> Any:
    if isinstance(given, CallableLaw):
        raise InvalidInputError(f"controller {name!r} is a CallableLaw: give the function itself")
    if (given.m, given.p) != (plant.m, plant.p):
        raise DimensionError(f"controller {name!r} reads {given.p} measurements and gives {given.m} inputs, but the plant "
                             f"has {plant.p} and {plant.m}")
    return given
