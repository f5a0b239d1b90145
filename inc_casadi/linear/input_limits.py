"""Whether a linear loop keeps its input limits for ever, from every initial state: steps first, then energy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, Protocol

import numpy as np

from ..arrays import Array
from ..definite import is_surely_positive
from ..errors import InvalidInputError
from ..readings import EPS, Rational, Rounded
from ..sets import Box, Distribution, Polytope
from ..sets.farthest import farthest
from .reach_of_rows import NO, YES, enclosing_box, is_below, verdicts

MOST_STEPS = 5000
_UP = 1 + 1e-12  # covers the rounding of sums of a few hundred nonnegative numbers


class LinearLoop(Protocol):
    """A loop z+ = F z with outputs G z, F and G in any arithmetic: what `read` returns has them as attributes."""

    def read(self, kind: Any) -> Any:
        """Return the loop with its matrices formed from the stored numbers in an arithmetic."""


class Facets(Protocol):
    """Half-spaces H u <= h of the first `dimension` outputs of a loop: H (f, dimension), h (f,)."""

    @property
    def H(self) -> Array:
        """Their normals."""

    @property
    def h(self) -> Array:
        """Their offsets."""

    @property
    def dimension(self) -> int:
        """The number of outputs that they limit."""


def limit_weight(inputs: Box | Polytope) -> Array | None:
    """Return R_w (m, m) with (H_i u)^2 <= h_i^2 u'R_w u for every facet i and every u, or None unless all h_i > 0.

    R_w = sum_i H_i'H_i / h_i^2. Of a bounded polytope the facets other than i span R^m, so the inequality is strict, and
    proved in floats.

    >>> limit_weight(Box(-1, 1)).tolist(), limit_weight(Box(0, 1))
    ([[2.0]], None)
    """
    H, h = inputs.H, inputs.h
    if not np.all(h > 0):
        return None
    R_w = (H / h[:, None]).T @ (H / h[:, None])
    R_w = (R_w + R_w.T) / 2
    for row, limit in zip(H, h, strict=True):
        square = Rounded.lift(R_w) * float(limit) * float(limit) - Rounded.lift(row[:, None]) @ Rounded.lift(row[None, :])
        if not is_surely_positive(square):
            return None
    return R_w


def limits_broken(loop: LinearLoop, inputs: Facets, initial: Distribution, xi_0: Array, W: Array,
                  names: Sequence[str] = (), shift: np.ndarray | None = None) -> str:
    """Return how the input limits are broken from some initial state, or why that is open; empty: kept for ever, proved.

    z = (x, xi), z+ = A_e z, u = G z, and W, R_w (`limit_weight`) with W >= G'R_w G + A_e'W A_e. Summed along the loop,
    sum_{j>=k} u_j'R_w u_j <= z_k'W z_k. So once z_k'W z_k <= 1 at all initial states, every facet has
    (H_i u_j)^2 <= h_i^2 from then on. The steps before are looked at one by one. z_k = M_k [x_0; 1] with rounded M_k:
    W does not let errors grow, |A_e e|_W <= |e|_W, so those of all steps add up, and |H_i G e| <= h_i |e|_W.

    Parameters
    ----------
    loop : plant and controller in `static_form`; the first m of its inputs are u
    initial : of x_0; xi_0 (l,)
    W : (n + l, n + l); that it satisfies the inequality is the caller's to prove
    shift : (n,) Fractions; with l = 0 the loop is that of x - shift, and the facets are those of its outputs
    names : what happens where a facet is left, in words, for each; "an input exceeds ..." when left out

    Notes
    -----
    Sufficient; after 5000 steps it is open. A step that is too close for floats is decided in Fractions.

    >>> from inc_casadi import INC, Plant, Uniform, close_loop
    >>> box, start = Box(-1, 1), Uniform(Box(-1, 1))
    >>> for gain in (-1.0, -1.1):  # W = 2 gain^2 / (1 - (1.5 + gain)^2) is enough, 4 is more
    ...     loop = close_loop(Plant(1.5, 1.0), INC.linear([[gain]]))
    ...     print(limits_broken(loop, box, start, np.zeros(0), np.array([[4.0]])) or "kept")
    kept
    at k = 0 an input exceeds a limit by 10 % of it: facet 0 of the input limits
    """
    try:
        center, half = enclosing_box(initial)
    except InvalidInputError as error:
        return f"the limits cannot be kept from every initial state, or it is open: {error}"
    rows = Rounded.lift(inputs.H) @ loop.read(Rounded).G[: inputs.dimension]
    reach, weights = np.abs(center) + half, np.sqrt(np.maximum(np.diag(W), 0.0)) * _UP
    for k, (M, lost) in enumerate(_motion(loop, initial.dimension, xi_0, weights, shift)):
        off = float(lost[:-1] @ reach + lost[-1]) * _UP
        if _energy(M, W, weights, center, half) + off <= 1 - 1e-9:
            return ""
        if off >= 1:
            return f"rounding has built up to the size of the limits by k = {k}, so whether they are kept is open"
        now = rows @ M
        spread = off * inputs.h + now.error[:, :-1] @ reach + now.error[:, -1]
        found = verdicts(initial, now.value[:, :-1], inputs.h - now.value[:, -1], spread * _UP, reach)
        for facet in np.flatnonzero(found != YES):
            if found[facet] == NO or not _is_kept(loop, inputs, initial, xi_0, k, int(facet), shift):
                return _words(k, int(facet), inputs, initial, now.value[facet], names)
    return f"the motion does not settle within {MOST_STEPS} steps, so whether the input limits are kept is open"


def _motion(loop: LinearLoop, n: int, xi_0: Array, weights: Array,
            shift: np.ndarray | None) -> Iterator[tuple[Array, Array]]:
    # M_k (n + l, n + 1) and bounds (n + 1,) on the W-norms of the errors of its columns.
    A = loop.read(Rounded).F
    M = np.vstack([np.eye(n, n + 1), np.hstack([np.zeros((xi_0.size, n)), xi_0[:, None]])])
    lost = np.zeros(n + 1)
    if shift is not None:
        nearest = Rounded.lift(shift)
        M[:, -1], lost[-1] = -nearest.value, float(weights @ nearest.error) * _UP
    for _ in range(MOST_STEPS):
        yield M, lost
        after = A @ M
        M, lost = after.value, (lost + weights @ after.error) * _UP


def _energy(M: Array, W: Array, weights: Array, center: Array, half: Array) -> float:
    # A bound on |M [x; 1]|_W over the box: its middle, and each half-width by itself.
    middle = M[:, :-1] @ center + M[:, -1]
    rounding = weights @ (4 * (len(center) + 4) * EPS * (np.abs(M[:, :-1]) @ np.abs(center) + np.abs(M[:, -1])))
    sides = Rounded.lift(np.column_stack([middle, M[:, :-1] * half]))
    forms = np.ones((1, len(W))) @ ((W @ sides) * sides)
    sizes = np.sqrt(np.maximum(forms.value + forms.error, 0.0))
    return float(sizes.sum() + rounding) * _UP


def _is_kept(loop: LinearLoop, inputs: Facets, initial: Distribution, xi_0: Array, k: int, facet: int,
             shift: np.ndarray | None) -> bool:
    # H_i G A_e^k (x_0, xi_0) <= h_i at every initial state, in Fractions.
    exactly = loop.read(Rational)
    row = Rational.lift(inputs.H[facet : facet + 1]) @ exactly.G[: inputs.dimension]
    for _ in range(k):
        row = row @ exactly.F
    entries, n = row.fractions()[0], initial.dimension
    constant = sum((a * Fraction(float(b)) for a, b in zip(entries[n:], xi_0, strict=True)), Fraction(0))
    if shift is not None:
        constant -= entries @ shift
    return is_below(initial, entries[:n], Fraction(float(inputs.h[facet])) - constant)


def _words(k: int, facet: int, inputs: Facets, initial: Distribution, row: Array, names: Sequence[str]) -> str:
    worst = farthest(initial, row[:-1, None])[:, 0]
    over = float(row[:-1] @ worst + row[-1] - inputs.h[facet])
    share = 100 * over / float(inputs.h[facet])
    if names:
        return f"at k = {k} {names[facet]} by {share:.3g} % of the way to there"
    return f"at k = {k} an input exceeds a limit by {share:.3g} % of it: facet {facet} of the input limits"
