"""What no linear controller can do: closed forms for one state, computed bounds for two, and a picture of each.

A linear controller of any order, started from a fixed state, makes a first move that is affine in the measurement, so the
input limit at the edge of the initial set holds its gain down in the middle too. The clipped law is not bound by that. On
the paper's scalar plant everything is a formula, exact on fractions; on the two-state plant the same comparison is computed
and every figure has a certificate behind it.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from inc_casadi import INC, Box, Plant, Regional, Spec, bounds, certify
from inc_casadi.linear.static_gain import best_static_gain
from inc_casadi.plotting import plot_bounds, plot_separation
from inc_casadi.plotting.cost_panel import AT_LEAST, AT_MOST, FOUND, Row

Figures = dict[str, float]


def one_state() -> bounds.ScalarSeparation:
    """Print the theorems' figures for discount 1 as fractions, draw them against the discount, and return them."""
    example = bounds.ScalarSeparation(Fraction(1))
    print(example.statement)
    print(f"In fractions: {example.relu_law}, {example.dynamic_linear}, {example.static_linear}. With x^2 + r u^2 as the "
          f"cost the law stays ahead of the bound for r < {example.threshold}.")
    counted = bounds.affine_moves(Plant(1.5, 1.0), Spec(1.0, 0.1, 1.0, Box(-1, 1), Box(-1, 1)))
    with_input = bounds.ScalarSeparation(1, Fraction(1, 10))
    print(f"For r = 1/10 the first move proves {float(with_input.dynamic_linear):.6f} of linear controllers, twenty moves "
          f"{float(counted):.6f}; the law costs {float(with_input.relu_law):.6f}.")
    plot_separation(example, path="scalar_separation.png")
    return example


def two_states() -> Figures:
    """Certify the clipped regulator, bound its competitors from below, draw the chart, and return the figures."""
    plant = Plant(A=[[1.1, 1.0], [0.0, 1.02]], B=[[0.2], [0.5]])
    spec = Spec(Q=np.eye(2), R=[[0.05]], discount=0.98, initial=Box([-0.8, -0.8], [0.8, 0.8]), inputs=Box([-1.0], [1.0]))
    law = INC.saturated([[-1.3749, -2.6490]], 1.0)
    certificate = certify(plant, law, Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount))
    linear, every = bounds.affine_moves(plant, spec), bounds.any_controller(plant, spec)
    gain = best_static_gain(plant, spec)
    for one in (certificate.sentence, linear, every):
        print(one)
    print(f"Settled rigorously: law {bool(certificate.prove())}, linear controllers {bool(linear.prove())}.")
    plot_bounds([
        Row("clipped regulator", certificate.bound, AT_MOST), Row("best static gain", gain.cost, FOUND),
        Row("linear controllers", float(linear), AT_LEAST), Row("any controller", float(every), AT_LEAST),
    ], "Two states: the clipped regulator against all linear control", "two_state_bounds.png")
    return {"clipped regulator": certificate.bound, "every linear controller at least": float(linear),
            "every controller at least": float(every), "best static gain found": gain.cost}


def main() -> tuple[Figures, Figures]:
    """Print what is proved, draw two pictures, and return computed and expected figures by name."""
    example = one_state()
    computed = {
        "scalar: the law": float(example.relu_law),
        "scalar: every linear controller at least": float(example.dynamic_linear),
        "scalar: the best static gain": float(example.static_linear),
        "scalar: separated for r below": float(example.threshold),
        **two_states(),
    }
    expected = {
        "scalar: the law": 13 / 36,
        "scalar: every linear controller at least": 5 / 12,
        "scalar: the best static gain": 4 / 9,
        "scalar: separated for r below": 8 / 41,
        "clipped regulator": 1.364962,
        "every linear controller at least": 2.116763,
        "every controller at least": 1.3649,
        "best static gain found": 3.3472,
    }
    return computed, expected


if __name__ == "__main__":
    main()
