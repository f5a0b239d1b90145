"""The largest slopes that each rung proves for published loops: equal, ordered, none beyond a growing motion.

One input: examples 1, 3, 5 of Carrasco, Heath, Zhang, Ahmad, Wang, IEEE TAC 65(11), 2020, Table II, negative feedback of
num / den with a unit of slope in [0, k]. Several: Park, IEEE TAC 47(2), 2002, example 3, sampled at 1e-4 s, and Turner,
Kerr, Sofrony, IJRNC 2015, example 19, sampled at 0.01 s, x+ = Ad x + alpha Bd relu(C x), with figures of Richardson,
Turner, Gunn, Drummond, L4DC 2024. Published values have three or four digits, so those used on both sides are computed
anew from the frequency response (circle) or from the quadratic constraints that the rung consists of.
"""

import numpy as np
import pytest

from inc_casadi import INC, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.claims import Stability
from inc_casadi.lmi_search import search
from inc_casadi.multipliers import LADDER, Lifted, Relu, Sector, Slope

SISO = {
    1: ([0.1, 0.0], [1, -1.8, 0.81]),
    3: ([-1, 1.95, -0.9, -0.05], [1, -2.8, 3.5, -2.412, 0.7209]),
    5: ([-0.5, 0.1], [1, -0.9, 0.79, 0.089]),
}
PARK = (
    -np.diag([1.0, 4, 6, 2, 9, 8, 3, 10, 12]),
    -np.eye(3)[[0, 1, 2, 1, 0, 2, 2, 0, 1]],
    np.kron(np.eye(3), np.ones((1, 3))),
    1e-4,
)
TURNER = (
    [
        [-5.4966, -1.7013, -1.7006, -1.0871, -0.3885, -0.256],
        [8, 0, 0, 0, 0, 0],
        [0, 2, 0, 0, 0, 0],
        [0, 0, 2, 0, 0, 0],
        [0, 0, 0, 2, 0, 0],
        [0, 0, 0, 0, 0.5, 0],
    ],
    [
        [-0.1747, 0.1242, -0.1618, -0.4348],
        [0.1069, -0.4609, 0.3498, 0.2012],
        [-0.2069, -0.2954, -0.1913, 0.5389],
        [-0.3018, 0.4648, 0.6416, 0.3872],
        [-0.3921, -0.0244, 0.4655, -0.5162],
        [-0.8676, -0.6227, 0.1863, 0.2499],
    ],
    [
        [-0.0874, -0.438, 0.2355, -0.1751, -0.3313, -0.0954],
        [-0.5379, 0.0904, -0.0862, 0.0422, 0.077, -0.2257],
        [-0.3988, 0.1378, -0.1092, 0.2767, 0.1642, -0.2763],
        [0.0327, -0.4871, -0.4322, 0.2185, -0.8372, 0.2476],
    ],
    0.01,
)
MIMO = {1: PARK, 6: TURNER}


def siso(example, k, unit):
    """The loop in controllable form."""
    num, den = SISO[example]
    n = len(den) - 1
    A, C = np.vstack([-np.array(den[1:]), np.eye(n - 1, n)]), np.array([[0.0] * (n - len(num)) + list(num)])
    return Plant(A, np.eye(n, 1), C), INC([[0.0]], [[1.0]], [[-k]], [[0.0]], activation=unit)


RELU = ReLU()


def mimo(example, alpha, unit=RELU):
    """The sampled loop."""
    A, B, C, Ts = MIMO[example]
    m = len(C)
    return Plant(A, B, C, dt=0).sampled(Ts), INC(
        np.zeros((m, m)), np.eye(m), alpha * np.eye(m), np.zeros((m, m)), activation=unit
    )


def proves(loop, rung, slowest=1e-9):
    """Whether a rung proves stability at some rate; proofs in floats and without any rounding must agree with it."""
    plant, inc = loop
    certificate = search(plant, inc, Stability(1 - slowest), rung)
    verdict = certificate.holds()
    assert bool(certificate.prove()) == bool(certificate.prove("exact")) == verdict
    return verdict


# The published circle values and the same computed anew, where the test is made on both sides.
CIRCLES = [
    (siso, 1, 0.7935, 0.793309288),
    (siso, 3, 0.1379, 0.137870643),
    (siso, 5, 1.0273, 1.027176193),
    (mimo, 1, 20.8, 20.858765527),
    (mimo, 6, 0.19, 0.194988520),
]


@pytest.mark.parametrize(("make", "example", "published", "circle"), CIRCLES)
def test_the_sector_rung_is_the_circle_criterion(make, example, published, circle):
    assert circle == pytest.approx(published, rel=1e-3 if make is siso else 0.03)
    for factor, expected in ((0.999, True), (1.001, False)):
        assert proves(make(example, factor * circle, ReLU()), Sector()) == expected
        assert proves(make(example, factor * circle, Tanh()), Sector()) == expected


@pytest.mark.parametrize(("example", "static", "lifted"), [(1, 0.8760, 12.98), (3, 0.2143, 0.305), (5, 1.9439, 2.4455)])
def test_one_relu_is_proved_further_by_the_lifted_rung(example, static, lifted):
    # static: quadratic constraints of ReLU over three steps, as published; ours are no weaker with one step in V.
    assert lifted > static
    for k in (static, lifted):
        assert proves(siso(example, k, ReLU()), Lifted()) and not proves(siso(example, k, ReLU()), Relu())
    assert not proves(siso(example, 1.01 * lifted, ReLU()), Lifted())


@pytest.mark.parametrize(("example", "static"), [(1, 40.13061692506285), (6, 0.4845242176106407)])
def test_repeated_relu_reaches_its_static_constraints(example, static):
    assert proves(mimo(example, 0.999 * static), Relu())
    assert not proves(mimo(example, 1.01 * static), Relu()) and not proves(mimo(example, 0.999 * static), Sector())


# circle, circle-like, Popov-like and Park-like figures of the L4DC table; then what was measured here.
@pytest.mark.parametrize(
    ("example", "alphas"), [
        (1, (450.0, 6000.0)), (6, (0.39, 0.62)),
        pytest.param(1, (20.8, 39.4, 411.0, 3310.0), marks=pytest.mark.slow),
        pytest.param(6, (0.19, 0.22, 0.50), marks=pytest.mark.slow),
    ]
)
def test_the_lifted_rung_exceeds_popov_and_park(example, alphas):
    for alpha in alphas:
        assert proves(mimo(example, alpha), Lifted()), alpha


@pytest.mark.parametrize(("unit", "beyond"), [(Saturation(), True), (Tanh(), True), (ReLU(), False)])
def test_odd_links_are_used_for_odd_units_only(unit, beyond):
    loop = close_loop(*siso(1, 1.0, unit))
    stack = Lifted().step(loop)
    names = [unknown.name for unknown in Lifted().unknowns(stack)]
    assert ("E" in names) == (unit == Tanh())
    # Saturation has kinks: what odd links say of it is in its products (see the tests of the relu multiplier).
    assert (names[0] == "N") == (unit != Tanh())
    repeated = close_loop(*mimo(6, 0.3, unit))
    assert ("E" in [unknown.name for unknown in Slope().unknowns(repeated)]) == beyond


@pytest.mark.parametrize(("example", "k"), [(1, 1.0), (3, 0.2), (5, 1.9)])
def test_repeated_over_time_saturation_and_tanh_are_proved_beyond_the_circle(example, k):
    for unit in (Saturation(), Tanh()):
        assert proves(siso(example, k, unit), Lifted(), 1e-7) and not proves(siso(example, k, unit), Sector(), 1e-7)


# Loops of examples 3 and 5 in other coordinates, x+ = A x + alpha B relu(C x): a motion that repeats
# after some steps, grown by a factor; the numbers were found by search and are checked here.
GROWING = {
    3: (
        [
            [0.49580601284300874, -0.8013115332378682, 0.03838925472553555, 0.003199564535367019],
            [0.8013115332378916, 0.5131789409615499, 0.08180646819148993, 0.011876414729954245],
            [-0.038389254725725866, 0.08180646819198943, 0.8218174881649903, -0.07028255203214134],
            [0.0031995645454949893, -0.011876414760072708, 0.07028255213641406, 0.9691975580304496],
        ],
        [[-1.1070764064177885], [0.20690035177649393], [-0.4318793918882891], [0.060904803295215464]],
        [[-1.1070764064176923, -0.20690035177671243, 0.4318793918849983, 0.06090480313780983]],
        0.6417507727488269,
        [0.7213327183666303, 0.26450280018875094, -0.4885938216562937, -0.41351354940970864],
        8,
        1.0225714070717011,
    ),
    5: (
        [
            [0.5372634639956024, -0.8041374705838844, -0.016208054112080747],
            [0.8041374705838852, 0.45336021698588647, 0.10343930004021164],
            [0.016208054112080705, 0.10343930004021164, -0.09062368098148887],
        ],
        [[0.5485236775480318], [-0.45183465313914434], [0.3110042942684988]],
        [[0.5485236775480323, 0.45183465313914295, -0.31100429426849924]],
        2.448723749999999,
        [0.8591925387457334, 0.3292173975923033, 0.39166833735472245],
        1,
        1.0006382184301912,
    ),
}


@pytest.mark.parametrize("example", GROWING)
def test_no_rung_proves_a_loop_in_which_a_motion_grows(example):
    A, B, C, alpha, x0, period, growth = GROWING[example]
    x = np.array(x0)
    for _ in range(period):
        x = np.array(A) @ x + alpha * np.array(B) @ np.maximum(np.array(C) @ x, 0.0)
    np.testing.assert_allclose(x, growth * np.array(x0), rtol=1e-6)
    law = INC([[0.0]], [[1.0]], [[alpha]], [[0.0]])
    for rung in (*LADDER, Lifted(2), Lifted(3)):
        if rung.refusal(close_loop(Plant(A, B, C), law)) is None:
            assert not proves((Plant(A, B, C), law), rung), rung


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "example", "gain", "rung"),
    [
        (siso, 1, 12.9, Lifted()),
        (siso, 1, 26.0, Lifted(3)),
        (siso, 3, 0.36, Lifted(3)),
        (siso, 5, 2.44, Lifted()),
        (mimo, 1, 7900.0, Lifted()),
        (mimo, 6, 0.62, Lifted()),
    ],
)
def test_what_is_proved_beyond_the_usual_criteria_converges(make, example, gain, rung):
    # Some lie beyond the Nyquist value, which bounds the class of all slope-restricted units, not ReLU.
    plant, inc = make(example, gain, ReLU())
    assert proves((plant, inc), rung, 1e-7 if make is siso else 1e-9)
    pushed = plant.B @ inc.V
    x = np.random.default_rng(3).normal(size=(plant.n, 400))
    start = np.linalg.norm(x, axis=0)
    peak = 0.0
    for k in range(40000):
        x = plant.A @ x + pushed @ np.maximum(plant.C @ x, 0.0)
        if k % 100 == 0:
            peak = max(peak, np.max(np.linalg.norm(x, axis=0) / start))
    assert np.max(np.linalg.norm(x, axis=0) / start) < 0.05 * peak
