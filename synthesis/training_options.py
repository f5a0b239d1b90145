"""The options of `train`, checked: which form of the NLP they ask for, and which one suits where they leave it open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

from inc_casadi.arrays import number
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.plant import Plant
from inc_casadi.sets import Box, Polytope
from inc_casadi.spec import Spec

from .phases import FORMS, Form
from .rollout import Parameters
from .training_nodes import COARSE
from .training_setup import Setup

_ALLOWED = {"form": FORMS, "method": ("adjoint", "graph"), "hessian": ("auto", "gauss-newton", "limited-memory"),
            "steps": ("spectral", "adam")}
_HOME = {"method": "shooting", "hessian": "shooting", "steps": "projected", "readout": "lifted"}


def form_of(plant: Plant, form: str, method: str, hessian: str, steps: str, readout: bool,
            states: Box | Polytope | None) -> Form:
    """Return the form that the options of `train` ask for; "auto" becomes the one that an option belongs to, if any does.

    Raises InvalidInputError for an unknown option, or one that belongs to another form; DimensionError where states are not
    in R^n.

    >>> form_of(Plant(1.0, 1.0), "auto", "adjoint", "auto", "adam", True, None).name
    'projected'
    """
    for name, value in (("form", form), ("method", method), ("hessian", hessian), ("steps", steps)):
        if value not in _ALLOWED[name]:
            raise InvalidInputError(f"{name} is {value!r}, but must be one of {', '.join(map(repr, _ALLOWED[name]))}")
    given, plain = Form(form, method, hessian, steps, bool(readout)), Form()
    named = [option.name for option in fields(Form)[1:] if getattr(given, option.name) != getattr(plain, option.name)]
    homes = {name: _HOME[name] for name in named} | ({} if states is None else {"states": "lifted"})
    if form == "auto" and homes:
        form = next(iter(homes.values()))
    for name, home in homes.items():
        if form != home:
            raise InvalidInputError(f"{name} belongs to the form {home!r}, but the form is {form!r}")
    _check_states(plant, states)
    return replace(given, name=form)


def settled(form: Form, problem: Setup) -> Form:
    """Return the form, or in place of "auto" the one that was measured to be the better for problems of this size.

    Shooting where its Gauss-Newton Hessian is affordable, which is up to about 8 to 20 units: it ends within 0.1 % of the
    best more often then, and sooner. Projected gradients beyond: there IPOPT is left with a limited-memory Hessian over
    2 q^2 variables. `python -m benchmarks speed training` repeats the measurement.
    """
    if form.name != "auto":
        return form
    newton = problem.sketch(problem.scenario(COARSE)) is not None
    return replace(form, name="shooting" if newton else "projected")


def _check_states(plant: Plant, states: Box | Polytope | None) -> None:
    if states is None:
        return
    if not isinstance(states, (Box, Polytope)):
        raise InvalidInputError(f"states must be a Box or a Polytope, not {type(states).__name__}")
    if states.dimension != plant.n:
        raise DimensionError(f"states has dimension {states.dimension}, but the plant has n = {plant.n} states")


def check_start(plant: Plant, spec: Spec, start: INC, kappa: float, frozen: Sequence[str]) -> None:
    """Refuse a start, a bound or names that no training takes.

    Raises
    ------
    DimensionError, InvalidInputError : what does not fit, by name
    """
    spec.check(plant)
    if not isinstance(start, INC):
        raise InvalidInputError(f"start must be an INC, not {type(start).__name__}")
    if (start.p, start.m) != (plant.p, plant.m):
        raise DimensionError(f"start maps {start.p} measurements to {start.m} inputs, but the plant has {plant.p} "
                             f"measurements and {plant.m} inputs")
    number("kappa", kappa, 0.0, 1.0, open_low=True, open_high=True)
    unknown = set(frozen) - set(Parameters._fields)
    if isinstance(frozen, str) or unknown:
        raise InvalidInputError(f"frozen must list names among {', '.join(Parameters._fields)}, not {frozen!r}")
