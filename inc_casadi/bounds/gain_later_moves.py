"""What the input limits at later moves demand of all gains of a small box: half-spaces with a remainder."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from .gain_algebra import Gains
from .gain_halfspaces import HalfSpaces
from .moves import UNIT


def later_moves(gains: Gains, points: Array, bounds: Array, moves: int, centers: Array, widths: Array) -> HalfSpaces:
    """Return half-spaces of the moves 1..K, K f a of them, that hold for every gain of a box that keeps the limits.

    With x_k = z + sum_j delta_j z_j + rest, |rest| <= e, one step on A0 z, A0 z_j + B_j z and

        e+ = (|A0| + sum_i w_i |B_i|) e + sum_ij w_i w_j |B_i z_j|,

    and H_u u_k = H_u F0 C z + sum_j delta_j H_u (F0 C z_j + G_j z) + rest', where rest' is bounded alike.

    points : (n, a) initial states; bounds : (f,) right-hand sides of the limits; moves : K >= 1
    centers, widths : (N, d)

    >>> from inc_casadi import Box, Plant, Spec
    >>> gains = Gains(Plant(2.0, 1.0), Spec(1.0, 0.0, 1.0, Box(-1, 1), Box(-1, 1)))  # u_1 = F (2 + F) x_0
    >>> found = later_moves(gains, np.ones((1, 1)), np.ones(2), 1, np.full((1, 1), -0.5), np.full((1, 1), 1e-9))
    >>> found.rows.ravel().tolist(), found.room.round(6).ravel().tolist()
    ([1.0, -1.0], [1.75, 0.25])
    """
    parts = list(_moves(gains, points, bounds, moves, centers, widths))
    rows = np.concatenate([slopes.reshape(len(centers), -1, gains.d) for slopes, _ in parts], axis=1)
    room = np.concatenate([space.reshape(len(centers), -1) for _, space in parts], axis=1)
    return HalfSpaces(centers, widths, rows, room)


def _moves(gains: Gains, points: Array, bounds: Array, moves: int, centers: Array,
           widths: Array) -> Iterator[tuple[Array, Array]]:
    # Move by move the slopes (N, f, a, d) and what is left of the limits (N, f, a).
    inputs, (G0, A0) = gains.spec.inputs, gains.closed(centers)
    assert inputs is not None
    N, n, d = len(centers), gains.plant.n, gains.d
    moved = np.abs(A0) + np.tensordot(widths, np.abs(gains.states), axes=1)
    H0, HG = inputs.H @ G0, inputs.H @ gains.inputs
    reach = np.abs(H0) + np.tensordot(widths, np.abs(HG), axes=1)
    z = np.broadcast_to(points, (N, n, points.shape[1]))
    size, dz, e = np.abs(z), np.zeros((N, d, *z.shape[1:])), np.zeros(z.shape)
    units = 8 * UNIT * (n + gains.plant.m + gains.plant.p + d)
    for _ in range(moves):
        e = moved @ e + _second(gains.states, dz, widths) + units * (moved @ size)
        z, dz = A0 @ z, A0[:, None] @ dz + gains.states @ z[:, None]
        size = moved @ size
        slopes = np.einsum("Nfn,Njnx->Nfxj", H0, dz) + np.einsum("jfn,Nnx->Nfxj", HG, z)
        yield slopes, bounds[:, None] - H0 @ z + _second(HG, dz, widths) + reach @ e + 2 * units * (reach @ size)


def _second(M: Array, dz: Array, widths: Array) -> Array:
    # sum_ij w_i w_j |M_i z_j| for M (d, r, n) and z (N, d, n, a).
    turned = np.abs(np.einsum("irn,Njnx->Nijrx", M, dz))
    return np.einsum("Nij,Nijrx->Nrx", widths[:, :, None] * widths[:, None], turned)
