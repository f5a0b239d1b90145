"""The exact expected cost of the two-state law by subdivision, against sampling it to four digits."""

from __future__ import annotations

from benchmarks.baselines import saturated_lqr
from benchmarks.plants import two_state
from inc_casadi import Regional, certify
from inc_casadi.estimate import estimate

from .measurement import Measurement, repeated

TARGET = 50.0
ACCURACY, SAMPLES = 1e-4, 20_000


def exact_cost(times: int = 15) -> list[Measurement]:
    """Return the time to certify the law with its exact cost, and how much longer sampling takes.

    Sampling has the standard error s at N samples and so needs N (s / 1e-4)^2 of them for an error of 1e-4; its time is
    extrapolated from a run of 20000.
    """
    case = two_state()
    law, spec = saturated_lqr(case.plant, case.spec), case.spec
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)  # type: ignore[arg-type]
    exact, least = repeated(lambda: certify(case.plant, law, claim).require().bound, times)
    run = estimate(case.plant, law, spec, samples=SAMPLES)
    sampled, _ = repeated(lambda: estimate(case.plant, law, spec, samples=SAMPLES), 3)
    needed = (run.standard_error / ACCURACY) ** 2
    return [
        Measurement("exact cost and proof, two states", 1e3 * exact, "ms", TARGET,
                    f"median of {times}, best {1e3 * least:.1f} ms"),
        Measurement("Monte Carlo to a standard error of 1e-4", sampled * needed, "s", None,
                    f"extrapolated from {SAMPLES} samples in {sampled:.3f} s to {needed * SAMPLES:.2g}"),
        Measurement("exact is faster by the factor", sampled * needed / exact, "x"),
    ]
