"""Every plant of the suite: what classes of controllers cost at least, beside the best of each class that was found."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

from benchmarks.baselines.dynamic import affordable
from benchmarks.contest.floors import floors
from benchmarks.contest.settings import Settings
from benchmarks.plants import Case, suite
from inc_casadi import INC, Box
from inc_casadi.comparison import Comparison, compare
from inc_casadi.comparison.families import LINEAR
from inc_casadi.comparison.row import CERTIFIED, LYAPUNOV, SIMULATED, VIOLATED, Cost, Finding, Row
from inc_casadi.errors import INCError, InvalidInputError
from inc_casadi.figures import at_least, at_most
from inc_casadi.linear.linear_cost import LinearCost
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.linear.static_gain import best_static_gain
from inc_casadi.pieces.walk import Budget

CLIPPED, DYNAMIC, GAIN = "clipped", "dynamic linear", "static gain"
CLASSES = {"any": "any >=", "linear": "linear >=", "static": "static >="}
HEADINGS = ("plant", "n m p", *CLASSES.values(), CLIPPED, DYNAMIC, GAIN, "clipped beats", "inverted", "s", "of")
CELLS = 3000  # for the bound on any controller
WIDTHS = (36, 6, 11, 11, 11, 12, 14, 12, 13, 8, 5, 5)
LEGEND = ("Costs are certified; ~ simulated, ! breaks the limits later on, ? not certified, - none found. "
          "A bound on a class is one on those within it.")


@dataclass(frozen=True, eq=False)
class Line:
    """One plant: its name, what was compared, the processor time, and which of how many it is."""

    name: str
    found: Comparison
    seconds: float
    place: str = "1/1"

    @property
    def beaten(self) -> str:
        """The largest class whose every member is proved to cost more than the clipped law, or ""."""
        laws = [row.name for row in self.found.rows]
        return next((key for key in CLASSES if CLIPPED in laws and self.found.separates(CLIPPED, key)), "")

    @property
    def inversions(self) -> list[str]:
        """What is contradictory: a bound above a certified cost of its class, or one that its numbers do not prove."""
        broken = [f"the numbers stored for the bound on {floor.family.title} do not prove it" for floor in self.found.floors
                  if floor.bound is not None and not self.found.confirms(floor)]
        return [str(one) for one in self.found.inversions()] + broken

    def __str__(self) -> str:
        plant = self.found.plant
        floors = [self.found.floor(key) for key in CLASSES]
        cells = [self.name, f"{plant.n} {plant.m} {plant.p}",
                 *("-" if floor is None else at_least(floor.value) for floor in floors),
                 *(_cost(self.found, name) for name in (CLIPPED, DYNAMIC, GAIN)), self.beaten,
                 "YES" if self.inversions else "none", f"{self.seconds:.1f}", self.place]
        return _aligned(cells)


def lines(cases: Mapping[str, Case], seconds: float = 5.0) -> Iterator[Line]:
    """Yield the line of each plant as soon as it is known.

    seconds: for the bound on static gains; four times that for that on linear controllers, and for the clipped law's pieces

    >>> from benchmarks.plants import scalar
    >>> [line] = lines({"scalar": scalar(0.9)})
    >>> line.inversions, round(line.found.cost_of("clipped"), 5), round(line.found.floor("linear").value, 5)
    ([], 0.35833, 0.40833)
    """
    for place, (name, case) in enumerate(cases.items(), 1):
        yield replace(_line(name, case, seconds), place=f"{place}/{len(cases)}")


def chosen(name: str | None = None) -> dict[str, Case]:
    """Return the suite, or the one plant of that name; raises InvalidInputError when there is none.

    >>> list(chosen("double integrator"))
    ['double integrator']
    """
    cases = suite()
    if name is None:
        return cases
    if name not in cases:
        raise InvalidInputError(f"no plant of the suite is named {name!r}; the names are {', '.join(cases)}")
    return {name: cases[name]}


def report(found: Iterable[Line], say: Callable[[str], Any] = print) -> int:
    """Say a line per plant, then what is contradictory; return 1 when anything is, else 0."""
    say(_aligned(HEADINGS))
    troubles, spent = [], list[float]()
    for line in found:
        say(str(line))
        spent.append(line.seconds)
        troubles += [f"{line.name}: {one}" for one in line.inversions]
    say(LEGEND)
    say(f"{len(spent)} plant{'' if len(spent) == 1 else 's'}, {sum(spent):.1f} s of processor time.")
    for trouble in troubles:
        say(f"INVERTED: {trouble}.")
    return int(bool(troubles))


def clipped_law(case: Case) -> INC:
    """Return u = sat(K x) with the regulator's gain, or u = sat(F y) with the best static gain found without limits.

    Raises
    ------
    INCError : the limits are no box, or no gain was found

    >>> from benchmarks.plants import scalar
    >>> clipped_law(scalar(0.9))([1.0]).tolist()
    [-1.0]
    """
    plant, spec = case.plant, case.spec
    if not isinstance(spec.inputs, Box):
        raise InvalidInputError(f"inputs is a {type(spec.inputs).__name__}, but clipping each input needs a Box")
    gain = discounted_lqr(plant, spec)[0] if plant.full_state else best_static_gain(plant, replace(spec, inputs=None)).F
    return INC.linear(gain).with_saturated_output(spec.inputs)


def _line(name: str, case: Case, seconds: float) -> Line:
    begun = process_time()
    laws = {key: law for key, law in _laws(case).items() if law is not None}
    found = compare(case.plant, case.spec, laws, budget=Budget(seconds=4 * seconds), bounds=())
    found = replace(found, floors=floors(case, Settings(cells=CELLS, gains=seconds, linear=4 * seconds)))
    dynamic = _tried(lambda: affordable(case))
    found = found if dynamic is None else replace(found, rows=(*found.rows, _row(dynamic)))
    return Line(name, found, process_time() - begun)


def _laws(case: Case) -> dict[str, Any]:
    return {CLIPPED: _tried(lambda: clipped_law(case)), GAIN: _tried(lambda: best_static_gain(case.plant, case.spec).F)}


def _row(found: LinearCost) -> Row:
    # It comes with its certificate of cost and limits, so it is not judged once more.
    return Row(DYNAMIC, found.controller, f"dynamic linear, order {found.controller.order}", LINEAR,
               Finding(CERTIFIED, "by its certificate"), cost=Cost(found.bound, LYAPUNOV, 0.0, found))


def _tried(search: Callable[[], Any]) -> Any:
    try:
        return search()
    except INCError:
        return None


def _cost(found: Comparison, name: str) -> str:
    row = next((row for row in found.rows if row.name == name), None)
    if row is None:
        return "-"
    if found.certifies(name):
        return at_most(found.cost_of(name))
    mark = {SIMULATED: "~"}.get(row.cost.how, "?")
    return f"{'!' if row.limits.verdict == VIOLATED else mark}{row.cost.value:.7g}"


def _aligned(cells: Iterable[str]) -> str:
    return "  ".join(cell.ljust(width) for cell, width in zip(cells, WIDTHS, strict=True)).rstrip()
