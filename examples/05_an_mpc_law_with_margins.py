"""Certify a predictive controller with what an engineer signs for: rate, cost, margins, gain from disturbances.

The quadratic program of a model predictive controller with |u| <= 1, solved by projected gradient steps until nothing moves,
is an implicit controller: eta = sat((I - g H) eta - g F x), u = first entry of eta. Its hidden loop fails the
Perron-Frobenius test, and a diagonal T with 2T - TW - W'T > 0 proves it well posed. The sector multiplier finds no
certificate; units that share one function, and an odd one, have the slope multiplier, and that does.
"""

from __future__ import annotations

import numpy as np

from inc_casadi import (
    INC,
    DiscountedCost,
    Gaussian,
    InputSector,
    L2Gain,
    Margins,
    Plant,
    Robust,
    Saturation,
    Stability,
    certify,
)

Figures = dict[str, float]
HORIZON = 6


def predictive_law(plant: Plant, Q: np.ndarray, R: np.ndarray, terminal: np.ndarray) -> INC:
    """Return the law that minimizes the cost over the horizon with |u| <= 1 and applies the first input."""
    n, m = plant.n, plant.m
    powers = [np.linalg.matrix_power(plant.A, k) for k in range(HORIZON + 1)]
    free = np.vstack(powers[1:])
    forced = np.zeros((n * HORIZON, m * HORIZON))
    for k in range(HORIZON):
        for j in range(k + 1):
            forced[n * k: n * (k + 1), m * j: m * (j + 1)] = powers[k - j] @ plant.B
    weights = np.kron(np.eye(HORIZON), Q)
    weights[-n:, -n:] = terminal
    H = forced.T @ weights @ forced + np.kron(np.eye(HORIZON), R)
    F = forced.T @ weights @ free
    g = 1.0 / np.linalg.eigvalsh(H)[-1]
    return INC(np.eye(len(H)) - g * H, -g * F, np.eye(m, len(H)), np.zeros((m, n)), activation=Saturation())


def main() -> tuple[Figures, Figures]:
    """Print what is proved and return computed and expected figures by name."""
    plant = Plant([[0.95, 0.2], [-0.1, 0.9]], [[0.0], [0.3]])
    Q, R = np.eye(2), np.array([[0.1]])
    terminal = np.array([[8.0, 2.0], [2.0, 5.0]])
    law = predictive_law(plant, Q, R, terminal)
    posed = law.well_posedness()
    print(f"well posed: {posed.test}")

    cost = DiscountedCost(Q, R, 1.0, Gaussian([0.0, 0.0], 4 * np.eye(2)))
    by_sector = certify(plant, law, cost, multiplier="sector")
    print(f"\n{by_sector.sentence}")
    claims = {"rate": Stability(), "cost": cost, "disk margin": Margins(), "gain": L2Gain(E=np.eye(2)),
              "gain with a weak actuator": Robust(L2Gain(E=np.eye(2)), InputSector(0.9, 1.1))}
    computed = {"Perron-Frobenius radius": posed.radius, "sector certificates": float(by_sector.holds())}
    for name, claim in claims.items():
        certificate = certify(plant, law, claim, multiplier="slope")
        proof = certificate.prove()
        print(f"\n{certificate.sentence}\nproved by {proof.method}: {proof.succeeded}, in {1e3 * proof.seconds:.0f} ms")
        computed[name] = certificate.bound if proof else np.nan
    expected = {
        "Perron-Frobenius radius": 1.53829,
        "sector certificates": 0.0,
        "rate": 0.967537,
        "cost": 126.392,
        "disk margin": 0.217895,
        "gain": 32.7867,
        "gain with a weak actuator": 54.0776,
    }
    return computed, expected


if __name__ == "__main__":
    main()
