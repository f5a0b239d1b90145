"""The loop around an equilibrium on kinks, which is linear on cones: the law in deviations, and how far it is valid."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import sqrt
from typing import NamedTuple

import numpy as np

from ..activations import Activation, TwoSlopes
from ..activations.stack import lipschitz, slopes
from ..arrays import Array
from ..blocks import exact
from ..errors import NotWellPosedError
from ..exact_rest import LARGEST, RestPoint, rest_point
from ..inc import INC
from ..multipliers.atoms import bends
from ..plant import Plant
from ..sets import Box, Polytope
from ..well_posed import error_from_residual
from .linear import solve

GUARD = 1 + 1e-6  # more than the rounding of a line of nonnegative floats
NO_KINK = "no hidden unit rests on a kink"
NEAR = 1e-12  # nearer to a bound than this, relative to the value when that is above 1, rounded numbers mean nothing


@dataclass(frozen=True, eq=False)
class ConewiseLaw:
    """A law in deviations from an equilibrium, exact as long as no unit gets past the kinks next to its own level.

    With e = x - x*, zeta = z - z*, a unit whose level z_i* is on a kink answers phi_i(z_i) - phi_i(z_i*) = a zeta for
    zeta <= 0 and b zeta for zeta >= 0, a and b the slopes beside the kink, any other unit s zeta with the slope of its
    piece. So eta~ = psi(W eta~ + U C e), u~ = K C e + V eta~ with homogeneous units psi_i (`TwoSlopes`): W, U, V, K are
    those of the law itself, the biases are gone, and nothing is rounded. Units with psi_i = 0 are left out. Around x* the
    loop is linear on each of finitely many cones.

    inc: this law; x (n,), z (q,), u (m,): the equilibrium in Fractions; kept: the units of the law that `inc` has;
    below, above (q,): distances, in Fractions or infinite, of z_i* to the next kinks on either side but the one it is on;
    on_kinks: the units that rest on one.
    """

    inc: INC
    x: np.ndarray
    z: np.ndarray
    u: np.ndarray
    kept: np.ndarray
    below: np.ndarray
    above: np.ndarray
    on_kinks: tuple[int, ...]


class _Beside(NamedTuple):
    """What a unit looks like from its level: slopes on the left and right, distances to the next kinks, on a kink or not."""

    left: Fraction
    right: Fraction
    below: Fraction | float
    above: Fraction | float
    on_kink: bool


def conewise_law(plant: Plant, inc: INC) -> ConewiseLaw | str:
    """Return the law around an equilibrium on kinks, or why there is none.

    The equilibrium is the origin where there are no biases, else `exact_rest.rest_point`: on a kink means z_i* equal to
    it in rational arithmetic.

    >>> from inc_casadi import Plant
    >>> law = INC([[0.0]], [[1.0]], [[-0.9]], [[0.0]], b=[1.0], d=[0.9])
    >>> conewise_law(Plant([[0.5]], [[1.0]]), law)
    'no hidden unit rests on a kink'
    >>> conewise_law(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[-0.9]], [[0.0]])).inc.activation
    (TwoSlopes(left=0.0, right=1.0),)
    """
    rest = _rest(plant, inc)
    if isinstance(rest, str):
        return rest
    beside = [_beside(unit, level) for unit, level in zip(inc.activations, rest.z, strict=True)]
    for i, near in enumerate(beside):
        gap = min(near.below, near.above)
        if gap < Fraction(NEAR) * max(1, abs(rest.z[i])):
            return (f"hidden unit {i} rests {float(gap):.3g} from a kink, but not on it: whether that is meant to be zero, "
                    "rounded numbers cannot say")
    on_kinks = tuple(i for i, near in enumerate(beside) if near.on_kink)
    if not on_kinks:
        return NO_KINK
    kept = np.array([i for i, near in enumerate(beside) if near.left != 0 or near.right != 0], dtype=int)
    units = tuple(TwoSlopes(float(beside[i].left), float(beside[i].right)) for i in kept)
    local = INC(inc.W[np.ix_(kept, kept)], inc.U[kept], inc.V[:, kept], inc.K, activation=units)
    below, above = (np.array([getattr(near, side) for near in beside], dtype=object) for side in ("below", "above"))
    return ConewiseLaw(local, rest.x, rest.z, rest.u, kept, below, above, on_kinks)


def _rest(plant: Plant, inc: INC) -> RestPoint | str:
    if inc.preserves_origin:
        return RestPoint(*(exact(np.zeros(size)) for size in (plant.n, inc.q, plant.m)))
    if plant.n + inc.q > LARGEST:
        return (f"the equilibrium of a biased loop is found in rational arithmetic up to {LARGEST} states and units, and "
                f"there are {plant.n + inc.q}")
    try:
        found = rest_point(plant, inc)
    except NotWellPosedError as error:
        return str(error)
    return "no equilibrium of the biased loop was found in rational arithmetic" if found is None else found


def _beside(unit: Activation, level: Fraction) -> _Beside:
    found = bends(unit)
    assert found is not None, "exact pieces are asked of piecewise-affine units only"
    kinks, steepness = found
    first = sum(kink < level for kink in kinks)
    on_kink = first < len(kinks) and kinks[first] == level
    last = first + on_kink
    below = level - kinks[first - 1] if first > 0 else float("inf")
    above = kinks[last] - level if last < len(kinks) else float("inf")
    return _Beside(steepness[first], steepness[last], below, above, on_kink)


class Room(NamedTuple):
    """A value at distance d from its bound at rest, that moves by at most sqrt(level) reach in {e'M e <= level}."""

    distance: Fraction
    reach: float
    name: str

    def holds(self, level: Fraction) -> bool:
        """Whether the bound is kept: level reach^2 <= d^2, decided in Fractions.

        A distance below 1e-12 is refused, so that underflow in `reach` has no say.
        """
        enough = self.distance >= Fraction(NEAR) and np.isfinite(self.reach)
        return bool(enough and level * Fraction(self.reach) ** 2 <= self.distance**2)


def rooms(plant: Plant, law: INC, local: ConewiseLaw, inputs: Box | Polytope | None, M: Array) -> list[Room]:
    """Return the room of every kink that a unit must not reach, and of every input limit, in ellipsoids {e'M e <= level}.

    On {e'M e <= 1} a row w'e is at most sqrt(w'M^{-1} w). So |U C e| <= r, and the solution eta~ of
    eta~ = psi(W eta~ + U C e) differs from 0 by at most what a residual |psi(U C e)| <= S r leaves,
    h = `error_from_residual`(S r). Then |zeta_i| <= r_i + (|W| h)_i and |H u~| <= |H K C e| + |H| |V| h. All of it scales
    with sqrt(level) since psi is homogeneous. Upper bounds: the forms in M are exact, each line of floats is inflated by
    1e-6.

    law: the law itself, of which `local` is the part around rest; M (n, n): positive definite.
    Raises numpy.linalg.LinAlgError when M is singular.
    """
    kept, units, C = local.kept, local.inc.activations, exact(plant.C)
    r = _radius(exact(law.U) @ C, M)
    test, S = local.inc.well_posedness(), lipschitz(units)
    h = error_from_residual(test, local.inc.W, slopes(units), GUARD * S * r[kept], GUARD)
    reach = GUARD * (r + GUARD * (np.abs(law.W[:, kept]) @ h))
    found = [Room(side[i], float(reach[i]), f"a kink of hidden unit {i}")
             for side in (local.below, local.above) for i in range(law.q) if side[i] != float("inf")]
    if inputs is not None:
        H, limit = exact(inputs.H), exact(inputs.h)
        distance = limit - H @ local.u
        V = (np.abs(inputs.H) @ np.abs(law.V[:, kept])) @ h
        reach = GUARD * (_radius(H @ exact(law.K) @ C, M) + GUARD * V)
        found += [Room(distance[i], float(reach[i]), f"input limit {i}") for i in range(len(limit))]
    return found


def _radius(rows: np.ndarray, M: Array) -> Array:
    """Upper bounds on |w'e| over {e'M e <= 1} for rows w (k, n) of Fractions."""
    if len(rows) == 0:
        return np.zeros(0)
    squares = (rows * solve(exact(M), rows.T).T).sum(axis=1)
    return np.array([GUARD * sqrt(square) for square in squares])


def largest_level(found: list[Room]) -> float:
    """Return the largest level, less 1e-9 of it, at which every bound keeps its room; infinite without bounds.

    >>> largest_level([Room(Fraction(1), 2.0, "a kink"), Room(Fraction(3), 0.0, "another")]) < 0.25
    True
    """
    if any(room.distance < Fraction(NEAR) for room in found):
        return 0.0
    return (1 - 1e-9) * min(((float(room.distance) / room.reach) ** 2 for room in found if room.reach > 0), default=np.inf)
