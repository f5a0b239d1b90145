"""The figures of sec:numerics_implicit: a controller with W != 0, certified."""

from __future__ import annotations

import numpy as np

from benchmarks.plants.paper import implicit_controller, implicit_example
from inc_casadi import INC, DiscountedCost, certify, fixed_point, simulate
from inc_casadi.certificate import MatrixCertificate
from inc_casadi.multipliers import Sector

from .direct_search import direct_search, largest_eigenvalue
from .row import Row

SOURCE, CERTIFICATE, TABLE = "sec:numerics_implicit", "eq:implicit_example_certificate", "tab:implicit_reproducibility"
PRINTED = {"P": np.array([[1.3006]]), "Lambda": np.array([0.7749, 0.7749])}


def rows() -> list[Row]:
    """Return the figures of the section, in its order."""
    return [*_controller(), *_printed_certificate(), *_direct(), *_searched(), *_exact_costs()]


def claim() -> DiscountedCost:
    """Return the performance claim of the section."""
    spec = implicit_example().spec
    return DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial)


def _controller() -> list[Row]:
    inc = implicit_controller()
    test = inc.well_posedness()
    eta, u = inc.hidden([1.0]), float(inc([1.0])[0])
    return [
        Row("lambda_pf(|W|)", "0.5", test.radius, TABLE),
        Row("||W||_inf", "0.5", test.norm, SOURCE),
        Row("Picard iterations on [-1, 1], tolerance 1e-10", "25", picard_iterations(inc), TABLE, "<="),
        Row("eta_1 at x = 1", "1.3043", float(eta[0]), SOURCE),
        Row("eta_2 at x = 1", "-0.4348", float(eta[1]), SOURCE),
        Row("u at x = 1", "-1.2174", u, SOURCE),
        Row("x+ at x = 1", "-0.01739", 1.2 + u, SOURCE),
    ]


def picard_iterations(inc: INC, tolerance: float = 1e-10) -> int:
    """Return how many Picard iterations from zero all points of a grid on [-1, 1] need."""
    test, y = inc.well_posedness(), np.linspace(-1, 1, 2001)[None]
    found = fixed_point.solve(inc.W, inc.U @ y + inc.b[:, None], inc.activations, rate=test.rate, weights=test.weights,
                              method="picard", tolerance=tolerance)
    return found.iterations


def printed_certificate(W: float = 1.0) -> MatrixCertificate:
    """Return the certificate of the printed P, Lambda, for a factor on the printed W.

    >>> printed_certificate().holds(), printed_certificate(0.0).holds()
    (True, False)
    """
    return MatrixCertificate(implicit_example().plant, implicit_controller(W), claim(), Sector(), PRINTED)


def _printed_certificate() -> list[Row]:
    printed = printed_certificate()
    conditions = printed.inequalities.conditions(printed.values)
    return [
        Row("lambda_max of the LMI at the printed P, Lambda", "-2.23e-5",
            -float(np.linalg.eigvalsh(conditions["decrease"])[0]), CERTIFICATE),
        Row("printed P, Lambda hold, 1 = yes", "1", float(printed.holds()), CERTIFICATE),
        Row("printed P, Lambda proved in fractions, 1 = yes", "1", float(printed.prove("exact").succeeded), CERTIFICATE),
        Row("E J at most, printed P", "0.4335", printed.bound, SOURCE),
    ]


def _direct() -> list[Row]:
    """The search as the section describes it; the cost is not below 1, the weight of x_0."""
    with_W, without = (printed_certificate(factor).inequalities for factor in (1.0, 0.0))
    found, plain = direct_search(with_W, 1.0, 3.0), direct_search(without, 1.0, 3.0)
    return [
        Row("P, direct search with Lambda = lambda I", "1.3006", found.P, TABLE),
        Row("lambda, direct search", "0.7749", found.lam, TABLE),
        Row("lambda_max of the LMI at the searched P, lambda, rounded", "-2.23e-5",
            largest_eigenvalue(with_W, found.rounded()), TABLE),
        Row("P, direct search with Lambda = lambda I, W = 0", "1.3570", plain.P, SOURCE),
    ]


def _searched() -> list[Row]:
    """P of the sector multiplier as found here; the complete ReLU multiplier ends at the exact cost."""
    plant = implicit_example().plant
    out = []
    printed = (("", 1.0, "1.3006", "0.4335", "1.0744"), (", W = 0", 0.0, "1.3570", "0.4523", "1.0789"))
    for name, factor, P, cost, exact in printed:
        sector = certify(plant, implicit_controller(factor), claim(), multiplier="sector").require()
        relu = certify(plant, implicit_controller(factor), claim(), multiplier="relu").require()
        out += [
            Row(f"P, sector multiplier{name}", P, 3 * sector.bound, SOURCE),
            Row(f"E J at most, sector multiplier{name}", cost, sector.bound, SOURCE),
            Row(f"P, relu multiplier{name}: the exact cost", exact, 3 * relu.bound, SOURCE),
        ]
    return out


def _exact_costs() -> list[Row]:
    plant, spec, _ = implicit_example()
    with_W = simulate(plant, implicit_controller(), [[1.0, -1.0]], steps=60).cost(spec.Q, spec.R, spec.discount)
    without = simulate(plant, implicit_controller(0.0), [1.0], steps=60)
    return [
        Row("exact cost from x0 = 1", "1.0744", float(with_W[0]), SOURCE),
        Row("exact cost from x0 = -1", "1.0744", float(with_W[1]), SOURCE),
        Row("gain, W = 0", "-1.05", float(without.u[0, 0]), SOURCE),
        Row("closed-loop multiplier, W = 0", "0.15", float(without.x[0, 1]), SOURCE),
        Row("exact cost from x0 = 1, W = 0", "1.0789", float(without.cost(spec.Q, spec.R, spec.discount)), SOURCE),
    ]
