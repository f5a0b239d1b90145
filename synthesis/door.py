"""What `synthesize` takes: a problem in discrete time that somebody can solve, and keywords that fit it."""

from __future__ import annotations

import inspect
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi import INC, Plant, Spec, bounds
from inc_casadi.activations import Activation
from inc_casadi.arrays import number
from inc_casadi.brief import Brief
from inc_casadi.errors import DimensionError, InfeasibleError, InvalidInputError, NotStabilizableError
from inc_casadi.plant import as_plant

OWN = ("kappa", "frozen", "form", "max_iterations", "time_limit", "progress", "seed")  # of `train`, set by `synthesize`


@dataclass(frozen=True, eq=False)
class Problem(Brief):
    """A plant in discrete time, its spec per step, and what to say about where they come from."""

    plant: Plant
    spec: Spec
    note: str = ""


def problem(plant: Any, spec: Spec, period: float | None) -> Problem:
    """Return the problem in discrete time; a continuous one is sampled with the period that is declared.

    The input is held over each period, and the cost is read as `inc_casadi.sampled` says: Q and R per second, the discount
    per second.

    Raises InvalidInputError for a continuous plant without a period, and for a discrete one with it.

    >>> from inc_casadi import Box
    >>> problem(Plant(1.0, 1.0, dt=0), Spec(1.0, 1.0, 0.9, Box(-1, 1)), 0.1).plant.dt
    0.1
    """
    plant = as_plant(plant)
    if not isinstance(spec, Spec):
        raise InvalidInputError(f"spec must be a Spec, not {type(spec).__name__}")
    if plant.discrete and period is None:
        return Problem(plant, spec)
    if plant.discrete:
        raise InvalidInputError(f"period = {period!r} samples a continuous plant, but this one is in discrete time already "
                                f"(dt = {plant.dt:g}): leave it out")
    if period is None:
        raise InvalidInputError("synthesize works in discrete time and this plant is continuous: give it period=, the "
                                "sampling period in seconds, with Q, R and discount per second; or plant.sampled(dt), with "
                                "all of them per step")
    from inc_casadi.sampled import sample

    found = sample(plant, spec, period)
    kind = "exactly" if found.exact else f"to {100 * found.error:.2g} % on the loop of the LQR"
    return Problem(found.plant, found.spec, f"the continuous plant is sampled every {found.plant.dt:g} s, the input held in "
                   f"between: costs and bounds are of the sampled problem, and {found.offset:+.6g} makes them those of the "
                   f"integral, {kind}")


def check(plant: Plant, spec: Spec, hidden: int, activation: Activation, kappa: float) -> None:
    """Refuse what does not fit, and problems that nobody can solve, with the reason."""
    if not isinstance(activation, Activation):
        raise InvalidInputError(f"activation must be an Activation such as ReLU(), not {activation!r}")
    number("kappa", kappa, 0.0, 1.0, open_low=True, open_high=True)
    if not isinstance(hidden, int | np.integer) or isinstance(hidden, bool) or hidden < 0:
        raise InvalidInputError(f"hidden = {hidden!r} must be a whole number of hidden units, 0 or more")
    spec.check(plant)
    modes = plant.unstabilizable_modes()
    if modes:
        words = ", ".join(f"{mode:.6g}" for mode in modes)
        raise NotStabilizableError(f"the plant is not stabilizable: no input reaches the mode with eigenvalue {words}")
    obstruction = bounds.uncontrollable_vertex(plant, spec)
    if obstruction:
        raise InfeasibleError(obstruction)


def given_laws(plant: Plant, start: INC | Sequence[INC]) -> tuple[INC, ...]:
    """Return the laws to begin with, each of the plant's measurements and inputs."""
    laws = (start,) if isinstance(start, INC) else tuple(start)
    for law in laws:
        if not isinstance(law, INC):
            raise InvalidInputError(f"start must be an INC or several, not {type(law).__name__}")
        if (law.p, law.m) != (plant.p, plant.m):
            raise DimensionError(f"start maps {law.p} measurements to {law.m} inputs, but the plant has {plant.p} "
                                 f"measurements and {plant.m} inputs")
    return laws


def names_in(keyword: str, names: Sequence[str] | None, known: Collection[str]) -> tuple[str, ...] | None:
    """Return names that a keyword lists, each of them known, or None.

    >>> names_in("frozen", ["W"], ("W", "U"))
    ('W',)
    """
    if names is None:
        return None
    if isinstance(names, str) or any(name not in known for name in names):
        raise InvalidInputError(f"{keyword} = {names!r} must list names among {', '.join(known)}")
    return tuple(names)


def training_options(plant: Plant, spec: Spec, form: str, options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return options for `train` that it takes together with the form: it is called once, to search nothing.

    Raises InvalidInputError for a name that `train` has not or that `synthesize` sets, and what `train` raises.

    >>> from inc_casadi import Box
    >>> plant, spec = Plant(0.9, 1.0), Spec(1.0, 1.0, 0.9, Box(-1, 1))
    >>> training_options(plant, spec, "projected", {"steps": "adam"})
    {'steps': 'adam'}
    """
    from .training import train

    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InvalidInputError(f"training_options must map names of options of train to values, not {options!r}")
    known = [name for name, one in inspect.signature(train).parameters.items() if one.kind is one.KEYWORD_ONLY
             and name not in OWN]
    for name in options:
        if name not in known:
            raise InvalidInputError(f"training_options has {name!r}, but may have {', '.join(known)}")
    if options:
        train(plant, spec, INC.linear(np.zeros((plant.m, plant.p))), form=form, max_iterations=0, **options)
    return dict(options)
