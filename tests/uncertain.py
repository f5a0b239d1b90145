"""Motions of a loop that is disturbed, uncertain or varying, stepped with the plain formulas of `oracles`."""

from __future__ import annotations

import numpy as np
import oracles


def disturbed(plant, inc, x0, w, E, D=None):
    """States (n, N, K + 1) and inputs (m, N, K) under x+ = A x + B u + E w, y = C x + D w; x0 (n, N), w (r, N, K)."""
    xs, us, x = [x0], [], x0
    for k in range(w.shape[-1]):
        y = plant.C @ x + (0.0 if D is None else np.asarray(D) @ w[..., k])
        u = oracles.control(inc, y)
        x = plant.A @ x + plant.B @ u + E @ w[..., k]
        xs.append(x)
        us.append(u)
    return np.stack(xs, axis=-1), np.stack(us, axis=-1)


def varying(inc, x0, steps, plant_at, actuator=None):
    """States (n, N, steps + 1) and inputs (m, N, steps); plant_at(k) is the plant of step k, actuator(k, u) what it gets."""
    xs, us, x = [x0], [], x0
    for k in range(steps):
        plant = plant_at(k)
        u = oracles.control(inc, plant.C @ x)
        x = plant.A @ x + plant.B @ (u if actuator is None else actuator(k, u))
        xs.append(x)
        us.append(u)
    return np.stack(xs, axis=-1), np.stack(us, axis=-1)


def circle(count, discrete=True):
    """Points of the stability boundary: the upper unit circle, or the imaginary axis from 1e-4 to 1e4."""
    return np.exp(1j * np.linspace(0, np.pi, count)) if discrete else 1j * np.logspace(-4, 4, count)


def response(A, B, C, D, points):
    """C (z I - A)^{-1} B + D at each point, (count, l, r)."""
    return np.array([C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D for z in points])


def peak(A, B, C, D, discrete=True):
    """The largest singular value of the response over the boundary, on a grid refined about its peak, and where it is."""
    grid = circle(2000, discrete)
    sizes = np.linalg.norm(response(A, B, C, D, grid), ord=2, axis=(1, 2))
    i = int(np.argmax(sizes))
    low, high = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    fine = (np.exp(1j * np.linspace(np.angle(low), np.angle(high), 400)) if discrete
            else 1j * np.linspace(low.imag, high.imag, 400))
    sizes = np.linalg.norm(response(A, B, C, D, fine), ord=2, axis=(1, 2))
    return float(np.max(sizes)), fine[int(np.argmax(sizes))]


def all_pass(z, phase):
    """(sign, p) with sign (1 - p z)/(z - p), |p| < 1, of the given phase at the point z of the unit circle."""
    for sign in (1.0, -1.0):
        poles = np.linspace(-1, 1, 200001)[1:-1]
        values = sign * (1 - poles * z) / (z - poles)
        miss = np.abs(values - np.exp(1j * phase))
        if np.min(miss) < 1e-3:
            return sign, float(poles[np.argmin(miss)])
    raise AssertionError("no first-order all-pass has that phase there")
