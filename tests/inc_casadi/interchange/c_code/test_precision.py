"""Single precision: the C is within its own bound of the exact law, whose coefficients are no floats."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import posed
import pytest
from c_compiler import compiled
from draws import controller
from exact_evaluation import exactly

from inc_casadi import INC, Box, LeakyReLU, ReLU, Saturation, Tanh
from inc_casadi.errors import InvalidInputError, NotWellPosedError
from inc_casadi.interchange.c_code import to_c

PIECES = (ReLU(), LeakyReLU(0.3), Saturation(), ReLU(), Saturation())
BOX = Box([-2.0] * 3, [2.0] * 3)


def measurements(rng, N, size=2.0):
    """Columns (3, N) of floats in single precision."""
    return rng.uniform(-size, size, (3, N)).astype(np.float32).astype(float)


def errors(inc, source, y, folder):
    """What the compiled source errs by at most over the columns of y, in exact arithmetic; its steps are as promised."""
    u, steps = compiled(source, folder)(y)
    off = [max(abs(Fraction(float(a)) - b) for a, b in zip(column, exactly(inc, at), strict=True))
           for column, at in zip(u.T, y.T, strict=True)]
    assert np.all((steps >= 0) & (steps <= source.iterations))
    assert all(gap <= Fraction(source.error(at)) for gap, at in zip(off, y.T, strict=True))
    return float(max(off))


@pytest.mark.parametrize("options", [{"method": "contraction"}, {"method": "newton"}, {"cache": True}, {"tol": 1e-3}])
def test_a_loop_is_within_the_bound_of_the_exact_law(options: dict, tmp_path):
    rng = np.random.default_rng(0)
    inc = controller(rng, m=2, p=3, units=PIECES, gain=1.0, norm=0.9, bias=0.4)
    source = to_c(inc, precision="float", inputs=BOX, **options)
    off = errors(inc, source, measurements(rng, 25), tmp_path)
    assert 1e-9 < off and source.error_bound < 0.2


@pytest.mark.parametrize("method", ["newton", "splitting"])
def test_a_loop_under_a_multiplier_is_too(method: str, tmp_path):
    inc = posed.controller(np.random.default_rng(9), PIECES, kind="skew")
    source = to_c(inc, precision="float", method=method)
    assert errors(inc, source, measurements(np.random.default_rng(1), 25), tmp_path) > 1e-9


def test_layers_are_too_and_for_every_measurement(tmp_path):
    rng = np.random.default_rng(2)
    sizes = (3, 5, 4, 2)
    inc = INC.from_layers([(rng.normal(size=(b, a)), rng.normal(size=b)) for a, b in zip(sizes, sizes[1:], strict=False)])
    source = to_c(inc, precision="float")
    y = np.concatenate([measurements(rng, 10, 10.0**power) for power in (-20, -3, 0, 8, 20)], axis=1)
    errors(inc, source, y, tmp_path)
    assert 1e30 < source.reach < 1e37


def test_the_rounding_of_the_coefficients_is_in_the_bound(tmp_path):
    inc = INC.linear([[0.1, 0.2, 0.7]])
    source = to_c(inc, precision="float")
    moved = inc.K[0].astype(np.float32).astype(float) - inc.K[0]
    y, rounded = 2.0**20 * np.sign(moved)[:, None], 2.0**20 * np.abs(moved).sum()
    off = errors(inc, source, y, tmp_path)
    assert off > 0.3 * rounded > 5e-3 and source.error(y[:, 0]) < 50 * off


def test_curved_units_are_within_the_bound(tmp_path):
    rng = np.random.default_rng(3)
    inc = controller(rng, m=2, p=3, units=(ReLU(), Tanh(), Saturation(), Tanh()), norm=0.9, gain=1.0, bias=0.3)
    y = measurements(rng, 100)
    for method in ("contraction", "newton"):
        source = to_c(inc, precision="float", method=method, inputs=BOX)
        off = np.abs(compiled(source, tmp_path / method)(y)[0] - inc(y)).max()
        assert 1e-8 < off <= source.error_bound + 1e-12


def test_limits_are_kept_as_they_were_asked_for(tmp_path):
    source = to_c(INC.saturated([[1.0]], 0.1), precision="float", limits=Box([-0.1], [0.1]))
    u, _ = compiled(source, tmp_path)([[-1.0, 1.0]])
    assert float(np.float32(0.1)) > 0.1 and np.all(np.abs(u) <= 0.1) and np.all(np.abs(u) > 0.1 - 1e-8)
    assert np.all(np.abs(np.abs(u) - 0.1) <= source.error([1.0]))
    assert "by itself for every y" in " ".join(source.header.split())


def test_the_limit_that_is_moved_is_in_the_bound(tmp_path):
    source = to_c(INC.linear([[0.0]]), precision="float", limits=Box([0.1], [0.2]))
    u, _ = compiled(source, tmp_path)([[1.0]])
    assert 1e-9 < u.item() - 0.1 <= source.absolute


def test_no_double_is_left_in_the_text():
    source = to_c(controller(np.random.default_rng(4), units=(ReLU(), Tanh()) * 2), precision="float", cache=False)
    assert "double" not in source.source and "const float y[4], float u[2]" in source.header and "tanhf(" in source.source


@pytest.mark.parametrize(("inc", "options", "error", "message"), [
    (INC.linear([[1.0]]), {"precision": "half"}, InvalidInputError, "must be 'double' or 'float'"),
    (INC.linear([[1e-40]]), {}, InvalidInputError, "coefficient of size 1e-40"),
    (INC.linear([[1e38]]), {}, InvalidInputError, "coefficient of size 1e\\+38"),
    (INC.linear([[1e30]]), {"inputs": Box([-1e30], [1e30])}, InvalidInputError, "floats do not hold"),
    (INC([[1 - 1e-7]], [[1.0]], [[1.0]], [[0.0]]), {}, NotWellPosedError, "within the rounding of floats"),
    (INC.linear([[1.0]]), {"tol": 1e-9}, InvalidInputError, "tol"),
    (INC.linear([[1.0]]), {"limits": Box([0.1], [0.1 + 1e-12])}, InvalidInputError, "no interval of single precision"),
])
def test_refusals(inc: INC, options: dict, error: type, message: str):
    with pytest.raises(error, match=message):
        to_c(inc, **{"precision": "float", **options})
