"""Certify a controller that somebody hands over: here the paper's, whose hidden units read each other (W is not zero).

Two multipliers are tried on the same controller. The sector says only that each unit lies between two lines; the relu
multiplier says all that quadratic constraints can say of a ReLU, and its bound is the true cost. Both certificates
are then proved in exact arithmetic, saved, loaded and proved again, without any solver.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from inc_casadi import INC, Box, DiscountedCost, LeakyReLU, Plant, Stability, Uniform, certify, load, simulate

Figures = dict[str, float]


def main() -> tuple[Figures, Figures]:
    """Print what is proved and return computed and expected figures by name."""
    plant = Plant(A=1.2, B=1.0)
    controller = INC(
        W=[[0.3, 0.2], [0.2, 0.3]],
        U=[[1.0], [-1.0]],
        V=[[-0.7, 0.7]],
        K=[[0.0]],
        activation=LeakyReLU(0.5),
    )
    cost = DiscountedCost(Q=[[1.0]], R=[[0.05]], discount=0.98, initial=Uniform(Box(-1, 1)))

    print(f"well posed: {controller.well_posedness().test}")
    sector = certify(plant, controller, cost, multiplier="sector")
    relu = certify(plant, controller, cost, multiplier="relu")
    stable = certify(plant, controller, Stability())
    for certificate in (sector, relu, stable):
        proof = certificate.prove()
        print(f"\n{certificate.sentence}\nproved by {proof.method}: {proof.succeeded}, in {1e3 * proof.seconds:.0f} ms")

    with tempfile.TemporaryDirectory() as folder:
        relu.save(Path(folder) / "certificate.json")
        again = load(Path(folder) / "certificate.json")
    print(f"\nloaded and proved again: {bool(again.prove())}")

    true = float(simulate(plant, controller, [1.0], steps=60).cost(cost.Q, cost.R, cost.discount))
    print(f"simulated from x0 = 1: cost {true:.6f}; certified from there: {3 * relu.bound:.6f}")

    computed = {
        "sector bound": sector.bound,
        "relu bound": relu.bound,
        "loaded bound": again.bound,
        "simulated cost from x0 = 1": true,
        "proofs": float(sum(bool(one.prove()) for one in (sector, relu, stable, again))),
        "1 - rate per step": 1 - stable.bound,
    }
    expected = {
        "sector bound": 0.4335,  # eq:implicit_example_certificate
        "relu bound": 1.07442 / 3,  # the true cost, for E x0^2 = 1/3
        "loaded bound": 1.07442 / 3,
        "simulated cost from x0 = 1": 1.0744,
        "proofs": 4.0,
        "1 - rate per step": 1 - 0.01739,  # the loop multiplies x by -0.01739; the search ends within 1e-4 of this speed
    }
    return computed, expected


if __name__ == "__main__":
    main()
