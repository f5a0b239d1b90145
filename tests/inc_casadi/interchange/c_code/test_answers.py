"""The C of a law gives what the law gives, within the bound that is stated, in no more steps than are stated."""

from __future__ import annotations

import numpy as np
import posed
import pytest
from c_compiler import compiled, in_long_doubles
from draws import controller, points
from reference import network, reference

from inc_casadi import INC, MPC, Box, CenteredLogistic, Identity, LeakyReLU, Logistic, Plant, ReLU, Saturation, Tanh
from inc_casadi.activations import TwoSlopes
from inc_casadi.interchange.c_code import to_c

SAME = 1e-12  # relative to 1 + |u|
PIECES = (ReLU(), LeakyReLU(0.3), Saturation(), TwoSlopes(-0.5, 0.75), Identity(), ReLU(), Saturation())
ALL = (*PIECES, Tanh(), Logistic(), CenteredLogistic(), Tanh())


def agree(inc, source, y, folder, *flags):
    """u of the compiled source, which is that of the law, within the stated bound and number of steps."""
    u, steps = compiled(source, folder, *flags)(y)
    want = in_long_doubles(inc, y)
    off = np.abs(u - want).max(axis=0)
    assert np.all(off <= SAME * (1 + np.abs(want).max(axis=0)))
    assert np.all(steps >= 0) and np.all(steps <= source.iterations)
    stated = [source.error(column) if source.inputs is None else source.error_bound for column in y.T]
    assert np.all(off <= np.array(stated))
    return u


@pytest.mark.parametrize(("q", "method"), [(0, "auto"), (1, "contraction"), (1, "newton"), (8, "contraction"), (8, "newton"),
                                           (15, "contraction"), (32, "auto"), (128, "contraction"), (61, "newton")])
def test_random_laws_with_a_full_W(q: int, method: str, tmp_path):
    rng = np.random.default_rng(q)
    inc = controller(rng, m=2, p=4, units=(ReLU(),) * q, gain=1.0 / max(q, 1), norm=0.95, bias=0.5)
    agree(inc, to_c(inc, method=method), points(rng, 4, 60), tmp_path, *(("-O3",) if q == 32 else ()))


@pytest.mark.parametrize("method", ["contraction", "newton"])
def test_units_of_every_kind_in_one_loop(method: str, tmp_path):
    rng = np.random.default_rng(1)
    inc = controller(rng, m=3, p=2, units=ALL, norm=0.9, bias=0.5)
    source = to_c(inc, method=method)
    assert source.curved > 0
    agree(inc, source, points(rng, 2, 80, 2.0), tmp_path)


def test_layers_take_one_pass(tmp_path):
    rng = np.random.default_rng(2)
    sizes = (3, 7, 1, 5, 2)
    layers = [(rng.normal(size=(b, a)), rng.normal(size=b)) for a, b in zip(sizes, sizes[1:], strict=False)]
    inc = INC.from_layers(layers, LeakyReLU(0.1))
    source = to_c(inc, method="one pass")
    agree(inc, source, points(rng, 3, 50), tmp_path)
    assert source.iterations == 0 and source.methods == ()


def test_loops_between_layers(tmp_path):
    rng = np.random.default_rng(3)
    W = np.zeros((12, 12))
    W[1:4, 0], W[1:4, 1:4] = 0.5, 0.3 * rng.normal(size=(3, 3))  # unit 0, a loop of three, one of four, a layer
    W[4:8, :4], W[4:8, 4:8] = rng.normal(size=(4, 4)), 0.2 * rng.normal(size=(4, 4))
    W[8:, 2:8] = rng.normal(size=(4, 6))
    order = rng.permutation(12)
    units = tuple(ALL[k % len(ALL)] for k in range(12))
    inc = INC(W[np.ix_(order, order)], rng.normal(size=(12, 2)), rng.normal(size=(2, 12)), rng.normal(size=(2, 2)),
              rng.normal(size=12), rng.normal(size=2), units)
    for method in ("contraction", "newton"):
        agree(inc, to_c(inc, method=method), points(rng, 2, 50), tmp_path / method)


def test_a_saturated_output_reads_the_loop(tmp_path):
    rng = np.random.default_rng(4)
    inc = controller(rng, m=2, p=3, norm=0.8, gain=1.0, bias=0.2).with_saturated_output(Box([-0.3, 0.0], [0.7, 0.1]))
    limits = Box([-0.3, 0.0], [0.7, 0.1])
    source = to_c(inc, limits=limits)
    u = agree(inc, source, points(rng, 3, 200, 3.0), tmp_path)
    assert np.all(limits.contains(u)) and "by itself for every y" in source.header


def test_points_on_kinks(tmp_path):
    inc = INC([[0.0, 0.5], [-0.5, 0.0]], np.eye(2), [[1.0, -2.0]], [[0.0, 0.0]], activation=(ReLU(), Saturation()))
    grid = np.array(np.meshgrid(np.linspace(-2, 2, 17), np.linspace(-2, 2, 17))).reshape(2, -1)
    for method in ("contraction", "newton"):
        agree(inc, to_c(inc, method=method), grid, tmp_path / method)


@pytest.mark.parametrize("method", ["contraction", "newton"])
def test_huge_and_tiny_measurements(method: str, tmp_path):
    rng = np.random.default_rng(5)
    inc = controller(rng, m=1, p=3, units=PIECES, norm=0.9)
    size = 10.0 ** np.repeat([-300, -20, 8, 100, 280], 10)
    y = size * rng.uniform(-1, 1, size=(3, 50))
    source = to_c(inc, method=method)
    u, steps = compiled(source, tmp_path)(y)
    assert source.reach > 1e280
    assert np.all(np.abs(u - in_long_doubles(inc, y)) <= SAME * np.maximum(size, 1.0))
    assert np.all((steps > 0) & (steps <= source.iterations))


@pytest.mark.parametrize("method", ["contraction", "newton"])
def test_a_measurement_that_is_no_number_gives_none(method: str, tmp_path):
    inc = controller(np.random.default_rng(6), m=2, p=3)
    y = np.zeros((3, 3))
    y[1] = [np.nan, np.inf, 0.0]
    u, steps = compiled(to_c(inc, method=method), tmp_path)(y)
    assert np.all(np.isnan(u[:, :2])) and np.all(np.isfinite(u[:, 2])) and steps[:2].tolist() == [0, 0]


@pytest.mark.parametrize("method", ["contraction", "newton"])
def test_it_ends_where_numbers_overflow(method: str, tmp_path):
    source = to_c(controller(np.random.default_rng(7), m=1, p=2), method=method)
    _, steps = compiled(source, tmp_path)(np.full((2, 2), [1e308, -1.7e308]))
    assert source.error([1e308, 0.0]) == np.inf and np.all(steps <= source.iterations)


@pytest.mark.parametrize(("horizon", "method"), [(1, "auto"), (4, "auto"), (10, "auto"), (4, "splitting")])
def test_predictive_laws(horizon: int, method: str, tmp_path):
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    inc = MPC(plant, np.eye(2), [[0.05]], horizon, Box([-1.0], [1.0])).inc()
    source = to_c(inc, method=method, inputs=Box([-9.0, -9.0], [9.0, 9.0]))
    y = np.random.default_rng(8).uniform(-9, 9, size=(2, 200))
    agree(inc, source, y, tmp_path)


@pytest.mark.parametrize("method", ["newton", "splitting"])
@pytest.mark.parametrize("kind", ["symmetric", "skew"])
@pytest.mark.parametrize("units", [PIECES, (Tanh(), ReLU(), Logistic(), LeakyReLU(0.2), CenteredLogistic())])
def test_laws_that_only_a_multiplier_proves(kind: str, units: tuple, method: str, tmp_path):
    units = tuple(unit for unit in units if unit != TwoSlopes(-0.5, 0.75))
    inc = posed.controller(np.random.default_rng(9), units, kind=kind)
    assert not inc.well_posedness().contracts
    source = to_c(inc, method=method)
    assert source.methods == ("newton and splitting" if method == "newton" else "splitting",)
    agree(inc, source, points(np.random.default_rng(10), 3, 50), tmp_path)


@pytest.mark.parametrize("name", ["evanqp_double_integrator_qp", "nflveripy_double_integrator"])
def test_published_networks(name: str, tmp_path):
    inc = network(reference(f"neural_controllers/{name}.json"))
    source = to_c(inc, name)
    agree(inc, source, np.random.default_rng(11).uniform(-3, 3, size=(inc.p, 200)), tmp_path)
    assert source.iterations == 0
