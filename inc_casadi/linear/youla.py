"""All linear controllers of finite order through their response to innovations, in which every motion is affine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..plant import Plant
from .controller import LinearController


@dataclass(frozen=True, eq=False)
class Observed:
    """A plant under u_k = K xhat_k + sum_j Q_j e_{k-j} + c_k, with an observer that supplies the innovations e.

    xhat_{k+1} = A xhat_k + B u_k + L e_k, e_k = y_k - C xhat_k, so that x - xhat = (A - L C)^k (x_0 - xhat_0) and
    e_k = C (A - L C)^k (x_0 - xhat_0) whatever the inputs are. Hence x_k and u_k are affine in (Q_j, c_j), j < N, and in
    x_0. Every linear controller is of this form with N unlimited (Youla, Jabr, Bongiorno, 1976); with N moves the
    order is n + (N - 1) m.

    Parameters
    ----------
    plant : in discrete time
    K : (m, n) with A + B K stable; L : (n, p)
    start : (n,) xhat_0
    moves : N >= 1
    """

    plant: Plant
    K: Array
    L: Array
    start: Array
    moves: int

    def errors(self, T: int) -> Array:
        """Return x_k - xhat_k as matrices on [x_0; 1], k = 0..T, (T + 1, n, n + 1)."""
        n = self.plant.n
        found = np.empty((T + 1, n, n + 1))
        found[0] = np.hstack([np.eye(n), -self.start[:, None]])
        for k in range(T):
            found[k + 1] = (self.plant.A - self.L @ self.plant.C) @ found[k]
        return found

    def motions(self, T: int) -> Motions:
        """Return the motions of T steps."""
        n, m, B, A_K = self.plant.n, self.plant.m, self.plant.B, self.plant.A + self.plant.B @ self.K
        errors = self.errors(T)
        innovations = self.plant.C @ errors[:T]
        pulse = np.zeros((T, 1, n + 1))
        pulse[0, 0, n] = 1.0  # c_j acts as Q_j does, on a pulse at k = 0
        driving = np.concatenate([innovations, pulse], axis=1)
        w = np.einsum("ac,kbs->kascb", np.eye(m), driving)  # input a, state s, answers to the entry (c, b) of Q_0 and c_0
        fixed = np.hstack([np.zeros((n, n)), self.start[:, None]])
        estimate = _rollout(A_K, fixed, self.L @ innovations)
        response = _rollout(A_K, np.zeros((n, w[0, 0].size)), B @ w.reshape(T, m, -1))
        response = response.reshape(T + 1, n, *w.shape[2:])
        inputs = np.einsum("ai,kiscb->kascb", self.K, response[:T]) + w
        return Motions(errors, estimate, self.K @ estimate[:T], self._delayed(response), self._delayed(inputs))

    def _delayed(self, response: Array) -> Array:
        # The answers to all unknowns, from those to Q_0 and c_0: (T, rows, n + 1, unknowns); c_{N-1} is left out.
        answers = np.zeros((*response.shape[:3], self.moves, *response.shape[3:]))
        for j in range(min(self.moves, len(response))):
            answers[j:, :, :, j] = response[: len(response) - j]
        return answers.reshape(*response.shape[:3], -1)[..., self._kept]

    @property
    def _kept(self) -> np.ndarray:
        kept = np.ones((self.moves, self.plant.m, self.plant.p + 1), dtype=bool)
        kept[-1, :, -1] = False
        return kept.ravel()

    def controller(self, unknowns: Array) -> LinearController:
        """Return the controller with these (Q_j, c_j): an observer and a shift register s of N - 1 inputs.

        u = K xhat + Q_0 e + s^1 and s^j+ = s^{j+1} + Q_j e, s^N = 0; the constants are its initial values.
        """
        A, B, C, K, m, p = self.plant.A, self.plant.B, self.plant.C, self.K, self.plant.m, self.plant.p
        full = np.zeros(self.moves * m * (p + 1))
        full[self._kept] = unknowns
        Q = full.reshape(self.moves, m, p + 1)
        n, length = self.plant.n, (self.moves - 1) * m
        entry = np.vstack([B @ Q[0, :, :p] + self.L, Q[1:, :, :p].reshape(length, p)])
        A_c = np.zeros((n + length, n + length))
        A_c[:n, :n] = A + B @ K
        A_c[:n, n : n + m] = B[:, : min(m, length)]
        A_c[n:, n:] = np.eye(length, k=m)
        A_c[:, :n] -= entry @ C
        C_c = np.hstack([K - Q[0, :, :p] @ C, np.eye(m, length)])
        return LinearController(A_c, entry, C_c, Q[0, :, :p], np.concatenate([self.start, Q[:-1, :, p].ravel()]))


@dataclass(frozen=True, eq=False)
class Motions:
    """Estimates and inputs over [x_0; 1], affine in the unknowns: fixed part plus response, unknowns last.

    errors (T + 1, n, n + 1); estimate (T + 1, n, n + 1); inputs (T, m, n + 1); estimate_response (T + 1, n, n + 1, .);
    input_response (T, m, n + 1, .). The state is the estimate plus the error.
    """

    errors: Array
    estimate: Array
    inputs: Array
    estimate_response: Array
    input_response: Array


def _rollout(A: Array, start: Array, forces: Array) -> Array:
    found = np.empty((len(forces) + 1, *start.shape))
    found[0] = start
    for k, force in enumerate(forces):
        found[k + 1] = A @ found[k] + force
    return found
