"""Lower bounds on quadratics over boxes cut by half-spaces, many at once: weak duality at points found by splitting."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from .moves import UNIT

SWEEPS = 30
_PENALTY, _RELAXED = 1.0, 1.6
_LEFT_OUT = 1e-12  # rows smaller than this are never divided by


def lowest(slope: Array, curvature: Array, rows: Array, room: Array, *, sweeps: int = SWEEPS) -> Array:
    """Return bounds (N,) from below on slope's + s'curvature s / 2 over |s_i| <= 1, rows s <= room.

    With curvature = V L V' + E the convex part is H = V max(L, 0) V', and the rest is at least
    -(sum_k max(-L_k, 0) |v_k|_1^2 + d |E|) / 2. For any trial point z and multipliers y >= 0

        slope's + s'Hs / 2 >= -z'Hz / 2 - y'room - sum_i |slope + Hz + rows'y|_i

    on the set, for s'Hs / 2 >= z'Hs - z'Hz / 2 and y'(rows s - room) <= 0. The trial comes from a few sweeps of the
    alternating direction method of multipliers, and need not be good. Of an empty set any number is a bound.

    Parameters
    ----------
    slope : (N, d); curvature : (N, d, d) symmetric; rows : (N, k, d); room : (N, k)
    sweeps : of the search; with none, the trial is the minimum along each axis, and y = 0

    Notes
    -----
    Sufficient. Rounding is subtracted.

    >>> one = np.ones((1, 1))
    >>> lowest(one, 2 * one[None], one[None], 5 * one).round(6).tolist()  # s + s^2 at -1/2
    [-0.25]
    >>> lowest(one, 2 * one[None], -one[None], 0 * one).round(3).tolist() == [0.0]  # s >= 0
    True
    """
    H, lost = _convex(curvature)
    z, y = _trial(slope, H, rows, room, sweeps) if sweeps else (_apart(slope, H), np.zeros_like(room))
    along = np.einsum("Nij,Nj->Ni", H, z)
    forces = slope + along + np.einsum("Nki,Nk->Ni", rows, y)
    value = -np.sum(z * along, axis=1) / 2 - np.sum(y * room, axis=1) - np.sum(np.abs(forces), axis=1)
    d, k = rows.shape[2], rows.shape[1]
    sizes = np.sum(np.abs(slope), axis=1) + 2 * d * np.sum(np.abs(H), axis=(1, 2))
    sizes = sizes + np.sum(y * (np.abs(room) + np.sum(np.abs(rows), axis=2)), axis=1)
    return value - lost - 8 * UNIT * (d * d + k + 8) * sizes


def _apart(slope: Array, H: Array) -> Array:
    steep = np.einsum("Nii->Ni", H)
    return np.clip(-np.divide(slope, steep, out=np.zeros_like(slope), where=steep > 1e-300), -1.0, 1.0)


def _convex(curvature: Array) -> tuple[Array, Array]:
    # The convex part and a bound on what is lost without the rest.
    L, V = np.linalg.eigh(curvature)
    missed = curvature - (V * L[:, None]) @ np.swapaxes(V, 1, 2)
    H = (V * np.maximum(L, 0.0)[:, None]) @ np.swapaxes(V, 1, 2)
    concave = np.sum(np.maximum(-L, 0.0) * np.sum(np.abs(V), axis=1) ** 2, axis=1)
    d = L.shape[1]
    size = np.sqrt(np.sum(curvature**2, axis=(1, 2)))
    return H, concave / 2 + d * (np.sqrt(np.sum(missed**2, axis=(1, 2))) + 16 * d * d * UNIT * size)


def _trial(slope: Array, H: Array, rows: Array, room: Array, sweeps: int) -> tuple[Array, Array]:
    # Minimize with x in the box and rows x in the half-spaces as copies; rows and objective are scaled to size one.
    N, k, d = rows.shape
    size = np.sqrt(np.sum(rows**2, axis=2))
    size = np.where(size > _LEFT_OUT, size, 1.0)
    G, g = rows / size[..., None], room / size
    scale = np.maximum(np.max(np.abs(slope), axis=1), np.max(np.abs(H), axis=(1, 2)))
    scale = np.where(scale > 0, scale, 1.0)
    K = np.linalg.inv(H / scale[:, None, None] + _PENALTY * (np.eye(d) + np.swapaxes(G, 1, 2) @ G))
    c = (slope / scale[:, None])[..., None]
    box, held = np.zeros((N, d, 1)), np.minimum(np.zeros((N, k, 1)), g[..., None])
    u, v = np.zeros((N, d, 1)), np.zeros((N, k, 1))
    transposed = np.swapaxes(G, 1, 2)
    for _ in range(sweeps):
        x = K @ (_PENALTY * (box - u + transposed @ (held - v)) - c)
        near, along = _RELAXED * x + (1 - _RELAXED) * box, _RELAXED * (G @ x) + (1 - _RELAXED) * held
        box = np.clip(near + u, -1.0, 1.0)
        held = np.minimum(along + v, g[..., None])
        u, v = u + near - box, v + along - held
    return box[..., 0], np.maximum(v[..., 0], 0.0) * _PENALTY * scale[:, None] / size
