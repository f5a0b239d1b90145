"""Names, kinds and the one formula in every kind of arithmetic."""

from dataclasses import replace

import draws
import numpy as np
import pytest

from inc_casadi import close_loop
from inc_casadi.blocks import exact
from inc_casadi.errors import InvalidInputError
from inc_casadi.multipliers import LADDER, Relu, Sector, Unknown, as_multiplier


def test_names():
    assert as_multiplier("relu") == Relu() and as_multiplier(Sector()) == Sector()
    with pytest.raises(InvalidInputError, match="'sector', 'relu'"):
        as_multiplier("circle")
    with pytest.raises(InvalidInputError, match="N is of kind 'positive'"):
        Unknown("N", (2, 2), "positive")


@pytest.mark.parametrize("multiplier", LADDER)
def test_floats_fractions_cvxpy_and_casadi_read_the_same(multiplier):
    import casadi as ca
    import cvxpy as cp
    rng = np.random.default_rng(21)
    loop = close_loop(draws.plant(rng), draws.controller(rng))
    values = {u.name: np.abs(rng.normal(size=u.shape)) for u in multiplier.unknowns(loop)}
    values = {name: v + v.T if name in ("N_sigma", "N_nu") else v for name, v in values.items()}
    M = multiplier.matrix(loop, values)
    fractions = multiplier.matrix(loop.exact(), {name: exact(v) for name, v in values.items()})
    assert all(type(entry).__name__ in ("Fraction", "int") for entry in fractions.flat)
    np.testing.assert_allclose(fractions.astype(float), M, atol=1e-12)
    searched = multiplier.matrix(loop, {name: cp.Constant(v) for name, v in values.items()})
    np.testing.assert_allclose(searched.value, M, atol=1e-12)
    symbol = ca.SX.sym("Z", *loop.Z.shape)
    differentiated = multiplier.matrix(replace(loop, Z=symbol), values)
    at = ca.Function("M", [symbol], [differentiated])(loop.Z).full()
    np.testing.assert_allclose(at, M, atol=1e-12)


@pytest.mark.parametrize("multiplier", LADDER)
def test_values_come_back_from_a_rescaled_twin(multiplier):
    from inc_casadi.lmi_frame import Frame
    rng = np.random.default_rng(22)
    loop = close_loop(draws.plant(rng), draws.controller(rng))
    T, sizes = rng.normal(size=(loop.n, loop.n)), 10.0 ** rng.uniform(-2, 2, size=loop.q)
    S = np.zeros((loop.n + loop.q,) * 2)
    S[: loop.n, : loop.n], S[loop.n:, loop.n:] = np.linalg.inv(T), np.diag(sizes)
    frame = Frame(T, S)
    values = {u.name: np.abs(rng.normal(size=u.shape)) for u in multiplier.unknowns(loop)}
    restored = multiplier.restored(loop, values, frame.S, frame.sizes)
    in_twin = multiplier.matrix(frame.twin(loop), values)
    np.testing.assert_allclose(S.T @ multiplier.matrix(loop, restored) @ S, in_twin, atol=1e-10)
