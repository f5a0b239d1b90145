"""The figures of the two-state example: gains, linear costs, the sampled cost and what it is exactly."""

from __future__ import annotations

import numpy as np

from benchmarks.baselines import control_lqr_gain, dense_search, saturated_lqr
from benchmarks.plants import two_state
from inc_casadi import bounds
from inc_casadi.arrays import Array
from inc_casadi.estimate import estimate
from inc_casadi.linear.regulator import discounted_lqr
from inc_casadi.linear.static_gain import best_static_gain, scaled_lqr_gain

from .row import Row
from .separation import exact_cost

SOURCE, RECORDED = "sec:numerics, two states", "recorded"
EXACT = "1.36496190"
SAMPLES = 200_000
AFFINE = ((1, "0.84652"), (2, "1.35080"), (3, "1.80115"), (5, "2.10376"), (8, "2.11675"), (20, "2.11676"))


def rows() -> list[Row]:
    """Return the figures of the section, then those that this toolbox adds to them."""
    return [*_gains(), *_linear_costs(), *_saturated(), *_lower_bounds()]


def _gains() -> list[Row]:
    plant, spec, _ = two_state()
    ours, theirs = discounted_lqr(plant, spec)[0], control_lqr_gain(plant, spec)
    return [
        Row("K_LQR, first entry", "-1.3749", float(ours[0, 0]), "eq:two_state_saturated_lqr"),
        Row("K_LQR, second entry", "-2.6490", float(ours[0, 1]), "eq:two_state_saturated_lqr"),
        Row("K_LQR, largest distance from python-control's", "0.00000000", float(np.max(np.abs(ours - theirs))),
            "control.dlqr"),
    ]


def _linear_costs() -> list[Row]:
    plant, spec, _ = two_state()
    best, (F, dense) = best_static_gain(plant, spec), dense_search(plant, spec)
    largest, step = largest_input(F)
    return [
        Row("best static gain, first entry", "-0.3535", float(best.F[0, 0]), SOURCE),
        Row("best static gain, second entry", "-0.8965", float(best.F[0, 1]), SOURCE),
        Row("best static gain, cost", "3.3472", best.cost, SOURCE),
        Row("best static gain by dense search, cost", "3.3472", dense, SOURCE),
        Row("largest |F x_k| over the initial set, k <= 100", "1.0000", largest, SOURCE),
        Row("step k at which it is attained", "0", step, SOURCE),
        Row("scaled LQR gain, cost", "3.5639", scaled_lqr_gain(plant, spec).cost, SOURCE),
    ]


def largest_input(F: Array, steps: int = 100) -> tuple[float, int]:
    """Return max over k <= steps of 0.8 ||F (A + B F)^k||_1, the largest input from the box of initial states, and its k.

    Of several k that attain it, the first.
    """
    plant, _, _ = two_state()
    row, inputs = F, []
    for _ in range(steps + 1):
        inputs.append(0.8 * float(np.sum(np.abs(row))))
        row = row @ (plant.A + plant.B @ F)
    k = int(np.argmax(inputs))
    return inputs[k], k


def _saturated() -> list[Row]:
    case = two_state()
    law = saturated_lqr(case.plant, case.spec)
    exact, run = exact_cost(case, law), estimate(case.plant, law, case.spec, samples=SAMPLES)
    return [
        Row("saturated law, exact, inside the sampled interval", "1.3579 +- 0.0071", exact, SOURCE),
        Row("two standard errors of the cost sampled here, 2e5 starts", "0.0071", 2 * run.standard_error, SOURCE),
        Row("saturated law, exact", EXACT, exact, RECORDED),
        Row("saturated law, sampled here, four standard errors", f"{EXACT} +- {4 * run.standard_error:.4f}", run.mean,
            RECORDED),
        Row("sampled largest input beyond its limit", "0.000000000", run.excess, SOURCE, "<="),
    ]


def _lower_bounds() -> list[Row]:
    plant, spec, _ = two_state()
    out = [Row(f"linear controllers at least, {N} move{'s' if N > 1 else ''}", printed,
               float(bounds.affine_moves(plant, spec, N)), "eq:Jlin_star" if N == 1 else RECORDED)
           for N, printed in AFFINE]
    return [*out, Row("any controller at least", "1.3648", float(bounds.any_controller(plant, spec)), RECORDED, ">=")]
