"""What the C of a law promises: a number of steps, an error bound, an end whatever happens, plain C99, a truthful header."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import posed
import pytest
from c_compiler import STRICT, compiled, compiler, compilers, in_long_doubles
from draws import controller, points

from inc_casadi import INC, MPC, Box, Plant, Regional, ReLU, Saturation, Spec, Tanh, certify, save
from inc_casadi.activations import Activation
from inc_casadi.errors import DimensionError, InvalidInputError, NotWellPosedError
from inc_casadi.interchange.c_code import to_c
from inc_casadi.interchange.c_code.expressions import CURVES, slope
from inc_casadi.linear import discounted_lqr

PLANT = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])


def slow_law(q=3, rate=0.9):
    """All units push each other up: from zero the contraction goes at its rate and no faster."""
    return INC(np.full((q, q), rate / q), np.ones((q, 1)), np.ones((1, q)), [[0.0]])


def test_the_stated_number_of_steps_is_nearly_needed(tmp_path):
    source = to_c(slow_law(), method="contraction")
    u, steps = compiled(source, tmp_path)([[1.0]])
    assert source.iterations - 40 < steps[0] <= source.iterations == 287
    assert abs(u.item() - 30.0) <= source.error([1.0])


def test_the_error_bound_is_not_wide(tmp_path):
    source = to_c(slow_law(), method="contraction", tol=1e-6, inputs=Box([0.9], [1.0]))
    u, _ = compiled(source, tmp_path)([[1.0]])
    assert 0.5 < abs(u.item() - 30.0) / source.error_bound <= 1.0


def test_no_more_steps_are_stated_where_the_box_keeps_the_start_small():
    small, large = (to_c(slow_law(), method="contraction", inputs=Box([-s], [s])).iterations for s in (1e-8, 1.0))
    assert small < large == to_c(slow_law(), method="contraction").iterations


@pytest.mark.parametrize("method", ["contraction", "newton"])
@pytest.mark.parametrize("tol", [1e-3, 1e-8])
def test_the_error_bound_holds_for_a_coarse_tolerance(tol: float, method: str, tmp_path):
    rng = np.random.default_rng(0)
    inc = controller(rng, m=2, p=3, units=(ReLU(), Tanh(), Saturation(), ReLU()), norm=0.97, gain=1.0, bias=0.3)
    y = points(rng, 3, 300)
    source = to_c(inc, method=method, tol=tol)
    u, steps = compiled(source, tmp_path)(y)
    off = np.abs(u - in_long_doubles(inc, y)).max(axis=0)
    assert np.all(off <= [source.error(column) for column in y.T]) and np.all(steps <= source.iterations)
    assert method == "newton" or off.max() > 1e-14


def test_the_error_of_one_loop_is_passed_on_to_the_next(tmp_path):
    first = INC([[0.9]], [[1.0]], [[1.0]], [[0.0]])
    W = np.array([[0.9, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 1.0, 0.5]])  # a slow loop, a layer that magnifies it, a fast loop
    inc = INC(W, [[1.0], [0.0], [0.0]], [[0.0, 0.0, 1.0]], [[0.0]])
    source, alone = (to_c(law, method="contraction", tol=1e-4, inputs=Box([0.5], [1.0])) for law in (inc, first))
    u, _ = compiled(source, tmp_path)([[1.0]])
    assert 0.3 * source.error_bound < abs(u.item() - 100.0) <= source.error_bound
    assert source.error_bound > 10 * alone.error_bound


def test_cancellation_in_front_of_a_curved_unit_is_within_the_bound(tmp_path):
    inc = INC([[0.0]], [[1e8 / 3, -1e8 / 7, 1e8 / 11]], [[1.0]], [[0.0, 0.0, 0.0]], activation=Tanh())
    y = np.random.default_rng(9).uniform(0.5, 1.0, size=(3, 200))
    y[2] = 11 * (y[1] / 7 - y[0] / 3)
    u, _ = compiled(source := to_c(inc), tmp_path)(y)
    off = np.abs(u - in_long_doubles(inc, y)).max(axis=0)
    assert off.max() > 1e-10 and np.all(off <= [source.error(column) for column in y.T])


@pytest.mark.parametrize("unit", [kind() for kind in CURVES])
def test_the_slope_of_a_curve_is_its_derivative(unit: Activation):
    z = np.linspace(-4, 4, 33)
    assert np.allclose(eval(slope(unit, "z", "f"), {"f": unit(z)}), unit.derivative(z), rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", ["newton", "splitting"])
def test_the_error_bound_holds_under_a_multiplier(method: str, tmp_path):
    inc = posed.controller(np.random.default_rng(7), (ReLU(), Saturation(), Tanh(), ReLU()), kind="skew")
    y = points(np.random.default_rng(8), 3, 200)
    source = to_c(inc, method=method, tol=1e-3)
    u, steps = compiled(source, tmp_path)(y)
    off = np.abs(u - in_long_doubles(inc, y)).max(axis=0)
    assert np.all(off <= [source.error(column) for column in y.T]) and np.all((steps >= 0) & (steps <= source.iterations))
    assert off.max() > 1e-7


def test_newton_ends_rightly_where_every_trial_is_refused(tmp_path):
    rng = np.random.default_rng(1)
    inc = controller(rng, m=2, p=3, norm=0.9, bias=0.5)
    source = to_c(inc, method="newton")
    assert source.source.count("* gap) {") == 1
    y = points(rng, 3, 100)
    u, steps = compiled(source, tmp_path, change=lambda text: text.replace("* gap) {", "* gap - 1e9) {"))(y)
    want = in_long_doubles(inc, y)
    assert np.all(np.abs(u - want) <= 1e-12 * (1 + np.abs(want)))
    assert 20 < steps.max() <= source.iterations


def test_a_trial_that_leads_away_is_refused(tmp_path):
    inc = slow_law()
    source = to_c(inc, method="newton", tol=1e-6, inputs=Box([0.5], [1.0]))
    spoilt = "eta[s->active_0[i]] = 200.0 * x[i];"
    law = compiled(source, tmp_path, change=lambda text: text.replace("eta[s->active_0[i]] = x[i];", spoilt))
    u, steps = law([[1.0]])
    assert abs(u.item() - 30.0) <= source.error_bound and 100 < steps[0] <= source.iterations


def test_splitting_ends_rightly_where_every_trial_fails(tmp_path):
    inc = MPC(PLANT, np.eye(2), [[0.05]], 4, Box([-1.0], [1.0])).inc()
    source = to_c(inc)
    y = np.random.default_rng(2).uniform(-5, 5, size=(2, 100))
    spoilt = "eta[s->active_0[i]] = x[i] + 1.0;"
    u, steps = compiled(source, tmp_path, change=lambda text: text.replace("eta[s->active_0[i]] = x[i];", spoilt))(y)
    assert np.abs(u - in_long_doubles(inc, y)).max() < 1e-11 and 50 < steps.max() <= source.iterations


def test_a_missed_residual_is_told(tmp_path):
    inc = MPC(PLANT, np.eye(2), [[0.05]], 4, Box([-1.0], [1.0])).inc()
    source = to_c(inc, method="splitting")
    law = compiled(source, tmp_path, change=lambda text: text.replace("k <= ", "k <= 8 && k <= "))
    _, steps = law([[0.3], [0.1]])
    assert steps[0] < 0


def test_the_cache_answers_at_once_where_the_pattern_stays(tmp_path):
    rng = np.random.default_rng(3)
    inc = controller(rng, m=2, p=3, units=(ReLU(),) * 6 + (Saturation(),) * 5, norm=0.95, bias=0.5)
    source = to_c(inc, cache=True)
    y = np.repeat(points(rng, 3, 40), 3, axis=1) * np.tile([1.0, 1 + 1e-9, 1 - 1e-9], 40)
    u, steps = compiled(source, tmp_path)(y)
    want = in_long_doubles(inc, y)
    assert np.all(np.abs(u - want) <= 1e-12 * (1 + np.abs(want)))
    assert np.all(steps[1::3] == 1) and np.all(steps[2::3] == 1) and np.all(steps <= source.iterations)


def test_the_cache_serves_predictive_laws(tmp_path):
    inc = MPC(PLANT, np.eye(2), [[0.05]], 6, Box([-1.0], [1.0])).inc()
    y = np.cumsum(0.02 * np.random.default_rng(4).normal(size=(2, 300)), axis=1)
    u, steps = compiled(to_c(inc, cache=True), tmp_path)(y)
    assert np.abs(u - in_long_doubles(inc, y)).max() < 1e-11 and np.median(steps) == 1


@pytest.mark.parametrize("level", ["-O1", pytest.param("-O3", marks=pytest.mark.slow)])
def test_every_kind_of_source_is_clean_c99(level: str, tmp_path):
    rng = np.random.default_rng(5)
    laws = {"linear": INC.linear([[1.0, 2.0]]), "clipped": INC.saturated([[1.0, 2.0]], 1.0),
            "mixed": controller(rng, m=5, p=2, units=(ReLU(), Tanh()) * 2),
            "predictive": MPC(PLANT, np.eye(2), [[0.05]], 3, Box([-1.0], [1.0])).inc(),
            "wide": controller(rng, m=1, p=2, units=(ReLU(),) * 17)}
    for name, inc in laws.items():
        for method in ("auto", "newton"):
            to_c(inc, f"{name}_{method}", method=method).write(tmp_path)
        to_c(inc, f"{name}_single", precision="float").write(tmp_path)
    to_c(laws["wide"], "cached", cache=True).write(tmp_path)
    to_c(laws["wide"], "cached_single", cache=True, precision="float").write(tmp_path)
    files = sorted(str(path) for path in tmp_path.glob("*.c"))
    for found in compilers():
        run = subprocess.run([found, *STRICT, level, "-c", *files], cwd=tmp_path, capture_output=True, text=True)
        assert run.returncode == 0 and len(files) == 17, run.stderr


def test_fast_math_is_refused(tmp_path):
    to_c(INC.linear([[1.0]])).write(tmp_path)
    run = subprocess.run([compiler(), "-ffast-math", "-c", "inc.c"], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode != 0 and "IEEE 754" in run.stderr


def test_the_header_names_law_and_certificate_by_their_digests(tmp_path):
    spec = Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8] * 2, [0.8] * 2), inputs=Box([-1.0], [1.0]))
    inc = INC.saturated(discounted_lqr(PLANT, spec)[0], 1.0)
    certificate = certify(PLANT, inc, Regional(Box([-0.8] * 2, [0.8] * 2), Box([-1.0], [1.0]), np.eye(2), [[0.05]], 0.98))
    save(inc, tmp_path / "law.json")
    certificate.save(tmp_path / "certificate.json")
    source = to_c(inc, "clipped", limits=Box([-1.0], [1.0]), certificate=certificate)
    header = " ".join(source.header.split())
    for file in ("law.json", "certificate.json"):
        assert json.loads((tmp_path / file).read_text())["digest"] in header
    assert "clipped to [-1.0, 1.0]" in header and certificate.sentence[:40] in header
    other = to_c(INC.saturated([[-1.0, -2.0]], 1.0), certificate=certificate)
    assert "another law than this one" in " ".join(other.header.split())


def test_the_output_is_clipped_where_the_law_does_not_keep_the_limits(tmp_path):
    source = to_c(INC.linear([[1.0]]), limits=Box([-1.0], [2.0]))
    u, _ = compiled(source, tmp_path)([[-3.0, 0.5, 3.0]])
    assert u.tolist() == [[-1.0, 0.5, 2.0]] and "is not known to keep them" in " ".join(source.header.split())


def test_operations_by_hand():
    # y - y and its sum, bias, from_y: 2, unit: test + 2, z: 2, u: V 2, K is zero, test of y: 2 and of u: 2
    assert to_c(INC([[0.0]], [[1.0]], [[2.0]], [[0.0]])).operations == 2 + 2 + 2 + 2 + 3


class Cubic(Activation):
    """A curved unit that the toolbox does not know."""

    def formula(self, z, ops):
        return z / (1 + z * z)

    def derivative(self, z):
        return (1 - z * z) / (1 + z * z) ** 2

    @property
    def slopes(self):
        return (-0.125, 1.0)


@pytest.mark.parametrize(("inc", "options", "error", "message"), [
    (INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), {"method": "one pass"}, InvalidInputError, "form a loop"),
    (INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), {"method": "splitting"}, InvalidInputError, "but this one contracts"),
    (INC([[-3.0]], [[1.0]], [[1.0]], [[0.0]]), {"method": "contraction"}, InvalidInputError, "does not contract"),
    (INC([[1.0]], [[1.0]], [[1.0]], [[0.0]]), {}, NotWellPosedError, "not proved well posed"),
    (INC([[1 - 1e-12]], [[1.0]], [[1.0]], [[0.0]]), {}, NotWellPosedError, "too near 1"),
    (INC([[0.5]], [[1.0]], [[1.0]], [[0.0]], activation=Tanh()), {"cache": True}, InvalidInputError, "curved"),
    (INC.linear([[1.0]]), {"cache": True}, InvalidInputError, "this law has none"),
    (INC.linear([[1.0]]), {"name": "double"}, InvalidInputError, "no name for a C function"),
    (INC.linear([[1.0]]), {"name": "offset"}, InvalidInputError, "something else in the same C file"),
    (INC([[0.5]], [[1.0]], [[1.0]], [[0.0]]), {"name": "solve_0"}, InvalidInputError, "something else in the same C file"),
    (INC.linear([[1.0]]), {"name": "a b"}, InvalidInputError, "no name for a C function"),
    (INC.linear([[1.0]]), {"method": "picard"}, InvalidInputError, "must be one of"),
    (INC.linear([[1.0]]), {"inputs": Box([0, 0], [1, 1])}, DimensionError, "inputs is a box in R\\^2"),
    (INC.linear([[1.0]]), {"tol": 0.0}, InvalidInputError, "tol"),
    (INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=Cubic()), {}, InvalidInputError, "Cubic has no affine pieces"),
    (INC.linear([[1e200]]), {"inputs": Box([-1e200], [1e200])}, InvalidInputError, "doubles do not hold"),
])
def test_refusals(inc: INC, options: dict, error: type, message: str):
    with pytest.raises(error, match=message):
        to_c(inc, **options)
