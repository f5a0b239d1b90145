"""Write a continuous piecewise-affine law as an exact INC with few units and nilpotent W (prop:pwa_relu)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..activations import ReLU
from ..arrays import number
from ..brief import Brief
from ..errors import ConvergenceError
from ..inc import INC
from ..pieces.regions import Regions
from .contact import contacts, require_convex
from .expression import Expression, fulfils, units
from .hinges import Hinges, Hyperplanes, hinged, hyperplanes
from .network import Network
from .order import ROUNDING, Order, distinct_laws, order
from .pieces import AffinePieces, Piece, at, collected
from .search import shortest_expression
from .shared import Shared, shared

TOL = 1e-8  # which jump counts as rounding when nothing is said, as a share of the largest |u|
FLOATS = 1e-10  # how far the INC may be off by the rounding of its evaluation, as a share of its largest law's values
DRAWS = 2000  # random points at which the INC is compared with the law


@dataclass(frozen=True, eq=False)
class Representation(Brief):
    """The INC of a piecewise-affine law, and what is known of it.

    inc: W strictly lower triangular; jump: the largest difference of the laws of two pieces where they meet; error: how far
    u is from the law of any piece at most, but for the rounding of evaluation; pieces: how many; laws (m,): how
    many distinct ones each output has; forms (m,): "hinges", "max-min", or "shared" for an output that combines
    others.
    """

    inc: INC
    jump: float
    error: float
    pieces: int
    laws: tuple[int, ...]
    forms: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """What was made of what, in one sentence."""
        laws = "+".join(map(str, self.laws))
        return (f"{self.pieces} pieces with {laws} affine laws, continuous but for {self.jump:.2g}, are an INC with "
                f"{self.inc.q} hidden units ({', '.join(self.forms)}), exact but for {self.error:.2g}.")


@dataclass(frozen=True, eq=False)
class _Form:
    """How one output is written: hinges, or else an expression of the laws of an order; how far off, and the units."""

    hinges: Hinges | None
    order: Order | None
    expression: Expression
    error: float

    @property
    def name(self) -> str:
        return "hinges" if self.hinges is not None else "max-min"


def represent(pieces: Sequence[Piece] | Regions, tol: float | None = None, saturations: bool = False,
              seed: int = 0) -> Representation:
    """Return a continuous piecewise-affine law as an INC, equal to it on the union of the pieces; prop:pwa_relu.

    Of two forms the one with fewer units is taken for each output:

    - hinging hyperplanes, f = c + sum_h w_h relu(s_h), where each kink runs straight through all pieces: one unit for each
      hyperplane, W = 0, and outputs share them (`hinged`);
    - an expression of maxima and minima of its L distinct laws, one unit for each binary max or min. L - 1 is the least that
      such an expression can take, and mostly reached (`shortest_expression`).

    An output that is an affine combination of others takes no unit. Checked before: the pieces fill a convex set
    (`require_convex`), and laws agree where pieces meet (`contacts`). Checked after, without the search: the expression has
    the right truth value on cells that fill the pieces, which proves it equal to f (`Order`); hinges are compared at all
    vertices; and the INC is evaluated at all vertices and at random points.

    Parameters
    ----------
    pieces : of (Box or Polytope in R^p, gain (m, p), offset (m,)), or what `regions` found
    tol : the largest jump that counts as rounding, in the units of u; 1e-8 of the largest |u| when left out
    saturations : whether max{a, min{b, s}}, b above a by a constant, becomes one saturation unit instead of two ReLU
    seed : for the random points

    Raises
    ------
    InvalidInputError : a jump (the two pieces, the point and the jump are named), a gap, a union that is not convex
    DimensionError : shapes that do not fit
    ConvergenceError : the INC is not the law, which rounding alone could bring about

    Notes
    -----
    Outside the pieces the INC is some continuous extension.

    >>> from inc_casadi import Box
    >>> found = represent([(Box([-2.0], [0.0]), [[-1.0]], [0.0]), (Box([0.0], [2.0]), [[1.0]], [0.0])])
    >>> found.inc.q, found.forms, found.inc([[-1.5, 0.0, 0.5]]).tolist()
    (1, ('hinges',), [[1.5, 0.0, 0.5]])
    """
    given = collected(pieces)
    require_convex(given)
    met = contacts(given)
    size = float(np.abs(given.values()).max())
    room = TOL * size if tol is None else number("tol", tol, 0.0)
    met.require(room)
    counts = [len(distinct_laws(given, output, room)[0]) for output in range(given.m)]
    common = shared(given, counts, room)
    table = hyperplanes(given, met.pairs, room)
    forms = [_form(given, table, int(output), room, saturations) for output in common.kept]
    inc = _network(given, common, forms, table)
    error = float((np.abs(common.weights) @ np.array([form.error for form in forms]) + common.error).max())
    _require_equal(inc, given, error, np.random.default_rng(seed))
    names = dict(zip(common.kept.tolist(), (form.name for form in forms), strict=True))
    return Representation(inc, met.jump, error, len(given), tuple(counts),
                          tuple(names.get(output, "shared") for output in range(given.m)))


def _form(pieces: AffinePieces, table: Hyperplanes, output: int, tol: float, saturations: bool) -> _Form:
    """The form of an output with the fewest units."""
    straight = hinged(pieces, table, output, tol)
    laws = order(pieces, output, tol)
    if straight is not None and len(straight.planes) <= (len(laws) - 1) / (2 if saturations else 1):
        return _Form(straight, None, 0, straight.error)
    slack = ROUNDING * float(np.abs(pieces.values()[:, :, output]).max())
    pairs = _constant_apart(pieces, laws, slack) if saturations else {}
    found = shortest_expression(laws, frozenset(pairs))
    if not fulfils(found, laws):
        raise ConvergenceError(f"the expression found for output {output} is not right on every piece")
    if straight is not None and len(straight.planes) <= units(found):
        return _Form(straight, None, 0, straight.error)
    return _Form(None, laws, found, laws.error + len(laws) * max(pairs.values(), default=0.0))


def _constant_apart(pieces: AffinePieces, laws: Order, slack: float) -> dict[tuple[int, int], float]:
    # Laws (a, b) with b above a by the same everywhere, to within the slack, and to within what.
    far = np.abs(pieces.origin) + pieces.widths
    tilt = (np.abs(laws.gain[:, None] - laws.gain[None]) * far).sum(axis=2)
    above = laws.offset[None] - laws.offset[:, None] > 2 * slack
    return {(int(a), int(b)): float(tilt[a, b]) for a, b in np.argwhere((tilt <= slack) & above)}


def _network(pieces: AffinePieces, common: Shared, forms: list[_Form], table: Hyperplanes) -> INC:
    straight = [form.hinges for form in forms if form.hinges is not None]
    planes = np.unique(np.concatenate([np.zeros(0, int), *(each.planes for each in straight)]))
    network = Network(pieces.p, len(planes) + sum(units(form.expression) for form in forms))
    kinks = [network.unit(network.affine(table.slope[h], table.shift[h]), ReLU()) for h in planes]
    outputs = []
    for form in forms:
        if form.hinges is None:
            assert form.order is not None
            outputs.append(network.expression(form.expression, form.order.gain, form.order.offset))
        else:
            mine = [kinks[i] for i in np.searchsorted(planes, form.hinges.planes)]
            outputs.append(network.affine(form.hinges.gain, form.hinges.offset) + sum(
                (w * kink for w, kink in zip(form.hinges.weight, mine, strict=True)), np.zeros(1)))
    rest = np.stack([network.affine(*law) for law in zip(common.gain, common.offset, strict=True)])
    return network.inc(rest + common.weights @ np.array(outputs).reshape(len(forms), rest.shape[1]))


def _require_equal(inc: INC, pieces: AffinePieces, error: float, rng: np.random.Generator) -> None:
    """Raise ConvergenceError when the INC is not the law at some vertex or at some of the random points."""
    drawn = rng.integers(len(pieces.corners), size=DRAWS)
    inside = np.einsum("nc,ncp->np", rng.dirichlet(np.ones(pieces.p + 1), size=DRAWS), pieces.corners[drawn])
    z = np.concatenate([pieces.corners.reshape(-1, pieces.p), inside])
    owner = np.concatenate([np.repeat(pieces.owner, pieces.p + 1), pieces.owner[drawn]])
    y = pieces.original(z)
    wanted = np.einsum("nmp,np->nm", pieces.gain[owner], y) + pieces.offset[owner]
    away = np.abs(inc(y.T).T - wanted)
    largest = float(np.abs(at(pieces.laws, pieces.points[None])).max())
    if away.max() > error + FLOATS * largest:
        row, output = np.unravel_index(int(away.argmax()), away.shape)
        raise ConvergenceError(f"at y = {y[row].tolist()} output {output} of the INC is off by {away.max():.3g}, more than "
                               f"the {error:.3g} that it should be")
