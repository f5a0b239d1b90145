"""The verb: set controllers beside what no member of their classes can undercut."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

from ..arrays import number
from ..errors import InvalidInputError
from ..figures import at_most
from ..pieces.walk import Budget
from ..plant import as_plant
from ..sets.rules import whole
from ..spec import Spec
from .comparison import Comparison
from .controllers import admitted, judge
from .effort import Effort, Say
from .families import Family, family_of
from .floors import floors
from .row import Row
from .table import figure
from .usual import usual_controllers


def compare(plant: Any, spec: Spec, controllers: Mapping[str, Any] | None = None, *,
            bounds: Iterable[str] = ("any", "linear", "static"), budget: Budget | None = None, cells: int = 3_000,
            moves: int | None = None, seconds: float = 30.0, samples: int = 20_000, seed: int = 0, prove: bool = False,
            verbose: bool = False) -> Comparison:
    """Return what controllers cost at most, what classes of controllers cost at least, and what follows.

    thm:general_superiority: a controller that keeps the limits from every initial state and whose certified expected cost
    is below a lower bound on a class costs less than every admissible member of it. The classes are nested: static linear
    gains, linear controllers of any finite order, all controllers; a bound on one is a bound on those within.

    Parameters
    ----------
    plant : Plant or control.StateSpace
    spec : Spec
    controllers : by name, an INC; a gain F (m, p) or StaticGain, u = F y; a LinearController or LinearCost; a DynamicINC; or
        a function from columns y (p, N) to u (m, N), which can only be simulated. None stands for those that anyone would
        try: the clipped regulator, the best static gain found, the scaled regulator
    bounds : the classes whose lower bounds are wanted
    budget : of the exact pieces of one controller
    cells, moves, seconds : work for the bounds on any controller, on linear ones (None: until the bound stops rising), and
        on static gains
    samples : simulated starting points where nothing is certified
    seed : of the simulation and the searches
    prove : whether to settle everything rigorously at once, as `Comparison.proved` does later
    verbose : a line per step

    Returns
    -------
    Comparison. A controller that fails, or a bound that cannot be had, is a line with its reason. Should a certified cost
    contradict a bound, a loud line says so; `require_consistent` raises.

    Raises
    ------
    InvalidInputError, DimensionError : a plant, spec, controller or class that is none or does not fit, by name

    Notes
    -----
    Sufficient: that a controller is not separated does not mean that a member of the class does better.

    Examples
    --------
    >>> from inc_casadi import INC, Box, Plant
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> laws = {"clipped": INC.saturated([[-1.5]], 1.0), "gain": [[-1.0]]}
    >>> found = compare(Plant(1.5, 1.0), spec, laws, bounds=["linear"], prove=True)
    >>> found.separates("clipped", "linear"), found.separates("gain", "linear"), found.inversions()
    (True, False, ())
    >>> print(found.statements[0].claim)
    Every admissible finite-order dynamic linear controller costs at least 0.4166666; clipped costs at most 0.3611112; both
    are proved.
    """
    clock = time.monotonic()
    plant = as_plant(plant)
    if not isinstance(spec, Spec):
        raise InvalidInputError(f"spec must be a Spec, not {type(spec).__name__}")
    spec.check(plant)
    families = _families(bounds)
    if not isinstance(budget, Budget | None):
        raise InvalidInputError(f"budget must be a Budget or None, not {budget!r}")
    effort = Effort(budget or Budget(), whole("cells", cells, 1), None if moves is None else whole("moves", moves, 1),
                    number("seconds", seconds, 0.0, open_low=True), whole("samples", samples, 2), whole("seed", seed, 0))
    say = _speaker(verbose, clock)
    chosen = usual_controllers(plant, spec, effort.seed) if controllers is None else admitted(plant, spec, controllers)
    rows = tuple(_said(judge(plant, spec, name, one, effort), say) for name, one in chosen.items())
    found = Comparison(plant, spec, rows, floors(plant, spec, families, effort, say))
    if prove:
        say("settling certificates and bounds rigorously")
        found = found.proved()
    for inversion in found.inversions():
        say(f"INCONSISTENT: {inversion}")
    return found


def _families(bounds: Iterable[str]) -> tuple[Family, ...]:
    if isinstance(bounds, str):
        raise InvalidInputError(f"bounds is {bounds!r}, but must list classes, such as ('any', 'linear')")
    return tuple(dict.fromkeys(family_of(key) for key in bounds))


def _said(row: Row, say: Say) -> Row:
    words = f"at most {at_most(row.bound)}, certified" if row.certified else f"{figure(row)}, {row.cost.how}"
    say(f"{row.name}: {words}")
    return row


def _speaker(verbose: bool, clock: float) -> Say:
    def say(line: str) -> None:
        if verbose:
            print(f"[{time.monotonic() - clock:5.1f} s] {line}", flush=True)
    return say
