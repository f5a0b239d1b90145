"""The laws a search moves among: a start whose free entries of W, U, V, K may change, and whose rest point may not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inc_casadi.activations.stack import evaluate, lipschitz
from inc_casadi.arrays import Array, number
from inc_casadi.errors import DimensionError, InvalidInputError
from inc_casadi.inc import INC
from inc_casadi.plant import Plant

NAMES = ("W", "U", "V", "K")
Frozen = Sequence[str] | Mapping[str, ArrayLike]
"""Names among W, U, V, K whose entries stay; or for some of them a mask, True where the entry stays."""


@dataclass(frozen=True, eq=False)
class Family:
    """theta = (W, U, V, K), row by row in one vector (P,), and the law that each theta stands for.

    The pre-activations at y = 0 stay what they are at the start, z0: b = z0 - W phi(z0) and d = -V phi(z0) follow. So
    u = 0 at y = 0 for every theta, and a law without biases stays one. Every law is well posed: with the units' largest
    slopes S, S|W| v <= kappa v for fixed weights v > 0, so lambda_pf(S|W|) <= kappa < 1 (thm:wellposed). v = 1 is
    ||S W||_inf <= kappa (prop:projected_training_wp); it is taken when the start satisfies it, else the weights of the
    start's own contraction (a saturated readout has large rows, but nothing reads them back).

    start: INC; free (P,): True where theta may move; scales (P,): the size of a change that counts; kappa; weights (q,).
    """

    start: INC
    free: Array
    scales: Array
    kappa: float
    weights: Array

    @property
    def rest(self) -> tuple[Array, Array]:
        """z0 (q,), the pre-activations at y = 0, and phi(z0)."""
        if not self.start.b.any():
            z = np.zeros(self.start.q)
            eta = evaluate(self.start.activations, z[:, None])[:, 0]
            if not eta.any():
                return z, eta
        eta = self.start.hidden(np.zeros(self.start.p))
        z = self.start.W @ eta + self.start.b
        return z, evaluate(self.start.activations, z[:, None])[:, 0]

    @property
    def slope(self) -> Array:
        """The units' largest absolute slopes (q,)."""
        return lipschitz(self.start.activations)

    @property
    def theta(self) -> Array:
        """The entries of the start (P,)."""
        return flat(self.start)

    def inc(self, theta: Array) -> INC:
        """Return the law with the entries theta (P,)."""
        W, U, V, K = unflat(theta, self.start)
        z, eta = self.rest
        return INC(W, U, V, K, z - W @ eta, -(V @ eta), self.start.activation)

    def about(self, inc: INC) -> Family:
        """Return the family about another of its laws; weights that are not 1 are chosen anew, which leaves W room."""
        keep = np.all(self.weights == 1.0)
        return replace(self, start=inc, weights=self.weights if keep else _weights(inc, self.kappa))


def family(plant: Plant, inc: INC, *, kappa: float = 0.95, frozen: Frozen = (),
           second_moment: Array | None = None) -> Family:
    """Return the family of a start.

    A change counts that moves a hidden unit by 1, or an input by what moves the state by its own size in one step, at
    measurements of the size that S0 gives them.

    Parameters
    ----------
    plant, inc : as for `certify`
    kappa : bound in (0, 1) on the weighted norm of S|W|
    frozen : names among W, U, V, K, or a mapping from such names to masks, True where the entry stays
    second_moment : S0 (n, n) of the initial state, the identity when left out

    Raises
    ------
    InvalidInputError : unknown names, kappa outside (0, 1), a W that is free but does not contract by kappa, or nothing free
    DimensionError : a mask of another shape

    >>> law = INC([[0.2]], [[1.0]], [[-0.5]], [[0.0]])
    >>> family(Plant([[0.5]], [[1.0]]), law, frozen=("W", "K")).free.tolist()
    [False, True, True, False]
    """
    number("kappa", kappa, 0.0, 1.0, open_low=True, open_high=True)
    free = np.concatenate([mask.ravel() for mask in _free(inc, frozen)])
    if not free.any():
        raise InvalidInputError(f"frozen = {frozen!r} leaves nothing to change")
    weights = _weights(inc, kappa) if free[: inc.W.size].any() else np.ones(inc.q)
    return Family(inc, free, _scales(plant, inc, second_moment, weights), float(kappa), weights)


def flat(inc: INC) -> Array:
    """Return the entries of W, U, V, K, each row by row."""
    return np.concatenate([np.ravel(getattr(inc, name)) for name in NAMES])


def unflat(theta: Array, like: INC) -> list[Array]:
    """Return the matrices whose entries `flat` lists, in the shapes of a law.

    >>> law = INC([[0.2]], [[1.0]], [[-0.5]], [[0.0]])
    >>> [part.item() for part in unflat(flat(law), law)]
    [0.2, 1.0, -0.5, 0.0]
    """
    shapes = [getattr(like, name).shape for name in NAMES]
    ends = np.cumsum([rows * columns for rows, columns in shapes])
    return [part.reshape(shape) for part, shape in zip(np.split(theta, ends[:-1]), shapes, strict=True)]


def readout(inc: INC) -> dict[str, Array]:
    """Return the masks that keep what `INC.with_saturated_output` built: its last m units stay what limits the input.

    V, K and the columns of W that would read the saturation units are frozen; what these units read is free.

    >>> from inc_casadi import Box
    >>> masks = readout(INC.linear([[2.0]]).with_saturated_output(Box([-1.0], [1.0])))
    >>> masks["U"].tolist(), masks["V"].tolist(), masks["W"].tolist()
    ([[False]], [[True]], [[True]])
    """
    W = np.zeros(inc.W.shape, dtype=bool)
    W[:, inc.q - inc.m:] = True
    return {"W": W, "U": np.zeros(inc.U.shape, dtype=bool), "V": np.ones(inc.V.shape, dtype=bool),
            "K": np.ones(inc.K.shape, dtype=bool)}


def _free(inc: INC, frozen: Frozen) -> list[Array]:
    masks = frozen if isinstance(frozen, Mapping) else {name: True for name in frozen}
    unknown = set(masks) - set(NAMES)
    if isinstance(frozen, str) or unknown:
        raise InvalidInputError(f"frozen must name matrices among {', '.join(NAMES)}, not {frozen!r}")
    found = []
    for name in NAMES:
        shape, mask = getattr(inc, name).shape, np.asarray(masks.get(name, False), dtype=bool)
        if mask.shape not in ((), shape):
            raise DimensionError(f"the mask of {name} in frozen has shape {mask.shape}, but {name} is {shape}")
        found.append(~np.broadcast_to(mask, shape))
    return found


def _weights(inc: INC, kappa: float) -> Array:
    """Return 1 where ||S W||_inf <= kappa, else v > 0 with S|W| v < kappa v."""
    M = lipschitz(inc.activations)[:, None] * np.abs(inc.W)
    if np.all(M.sum(axis=1) <= kappa):
        return np.ones(inc.q)
    radius = float(np.max(np.abs(np.linalg.eigvals(M))))
    v = np.linalg.solve(0.5 * (radius + kappa) * np.eye(inc.q) - M, np.ones(inc.q)) if radius < kappa else np.zeros(inc.q)
    if not (np.all(v > 0) and np.all(M @ v <= kappa * v)):
        raise InvalidInputError(f"W is free, but lambda_pf(S|W|) = {radius:.6g} is not below kappa = {kappa:g} "
                                "(thm:wellposed): raise kappa, project W first, or freeze W")
    return v / v.min()


def _scales(plant: Plant, inc: INC, second_moment: Array | None, weights: Array) -> Array:
    S0 = np.eye(plant.n) if second_moment is None else second_moment
    y = np.sqrt(np.maximum(np.einsum("in,nk,ik->i", plant.C, S0, plant.C), 0.0))
    y = np.where(y > 0, y, 1.0)
    reach = np.linalg.norm(plant.B, axis=0)
    u = np.sqrt(max(float(np.trace(S0)), 1e-300)) / np.where(reach > 0, reach, 1.0)
    parts = (np.outer(weights, 1 / weights), np.outer(weights, 1 / y), np.outer(u, 1 / weights), np.outer(u, 1 / y))
    return np.concatenate([part.ravel() for part in parts])
