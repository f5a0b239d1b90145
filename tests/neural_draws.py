"""Neural loops with unstable plants: small nets that act like a linear regulator near rest, of every kind of unit."""

from __future__ import annotations

import numpy as np
from attraction_draws import lqr

from inc_casadi import INC, Box, CenteredLogistic, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh

CURVED = (Tanh(), Tanh(), Tanh(), Tanh())
MIXED = (LeakyReLU(0.2), Tanh(), ReLU(), CenteredLogistic(), Saturation(), Logistic())


def neural(rng, units=CURVED, n=2, m=1, radius=1.15, bias=0.0, feedback=0.0, limit=None, gain=2.0):
    """An unstable plant, and a net with phi(U y + W eta + b) scaled so that its slope at rest is about that of an LQR."""
    A = rng.normal(size=(n, n))
    plant = Plant(A * (radius / np.max(np.abs(np.linalg.eigvals(A)))), rng.normal(size=(n, m)))
    q = len(units)
    U = rng.normal(size=(q, n))
    slope = np.array([0.5 if isinstance(unit, ReLU) else float(unit.derivative(0.1)) for unit in units])
    V = gain * lqr(plant) @ np.linalg.pinv(slope[:, None] * U)
    W = rng.normal(size=(q, q))
    inc = INC(feedback * W / np.max(np.abs(W).sum(axis=1)), U / gain, V, np.zeros((m, n)), bias * rng.normal(size=q),
              activation=units)
    return plant, inc if limit is None else inc.with_saturated_output(Box(-limit * np.ones(m), limit * np.ones(m)))


def two_layers(rng, n=2, first=5, second=4, limit=None, bias=0.0):
    """A plant and a tanh net of two layers with its LQR's slope at rest."""
    A = rng.normal(size=(n, n))
    plant = Plant(A * (1.1 / np.max(np.abs(np.linalg.eigvals(A)))), rng.normal(size=(n, 1)))
    W1, W2 = rng.normal(size=(first, n)) / 2, rng.normal(size=(second, first)) / 2
    W3 = lqr(plant) @ np.linalg.pinv(W2 @ W1)
    layers = [(W1, bias * rng.normal(size=first)), (W2, np.zeros(second)), (W3, np.zeros(1))]
    inc = INC.from_layers(layers, Tanh())
    return plant, inc if limit is None else inc.with_saturated_output(Box([-limit], [limit]))
