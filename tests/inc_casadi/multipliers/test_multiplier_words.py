"""Names, kinds, and the one formula in every kind of arithmetic."""

from dataclasses import replace

import draws
import multiplier_draws as md
import numpy as np
import pytest

from inc_casadi import CenteredLogistic, Identity, LeakyReLU, ReLU, Saturation, Tanh, close_loop
from inc_casadi.errors import InvalidInputError
from inc_casadi.multipliers import LADDER, Lifted, Relu, Sector, Slope, Unknown, as_multiplier
from inc_casadi.readings import Rational, Rounded

UNITS = {
    "kinked and curved": (ReLU(), Tanh(), Saturation(), Tanh(), Identity(), ReLU(), md.THREE, LeakyReLU(0.3)),
    "curved": (Tanh(), CenteredLogistic(), Tanh(), md.Lopsided(), md.Lopsided()),
    "biased": (ReLU(), Saturation(), md.DEAD_ZONE, Identity()),
}
SPEAKS = {
    "kinked and curved": (*LADDER, Lifted(2)),
    "curved": (Sector(), Slope(), Lifted()),
    "biased": (Sector(), Relu(), Lifted()),
}
CASES = [(units, multiplier) for units, speaks in SPEAKS.items() for multiplier in speaks]


def loop_of(units, seed=21):
    rng = np.random.default_rng(seed)
    bias = 1.0 if units == "biased" else 0.0
    return close_loop(draws.plant(rng), draws.controller(rng, units=UNITS[units], bias=bias)), rng


def test_names():
    assert [as_multiplier(multiplier.name) for multiplier in LADDER] == list(LADDER) == [Sector(), Slope(), Relu(), Lifted()]
    assert as_multiplier(Lifted(2)) == Lifted(2) and Lifted(2).name == "lifted 2"
    with pytest.raises(InvalidInputError, match="'sector', 'slope', 'relu', 'lifted'"):
        as_multiplier("circle")
    with pytest.raises(InvalidInputError, match="N is of kind 'positive'"):
        Unknown("N", (2, 2), "positive")


@pytest.mark.parametrize("steps", [0, -1, 1.5, np.nan])
def test_lifting_by_no_whole_number_of_steps_is_refused(steps):
    with pytest.raises(InvalidInputError, match="steps"):
        Lifted(steps)


def test_which_entries_are_free_and_signed():
    zero, unsigned = np.array([[True, False], [False, False]]), np.array([[False, True], [False, False]])
    unknown = Unknown("N", (2, 2), "nonnegative", zero=zero, unsigned=unsigned)
    assert unknown.free.tolist() == [[False, True], [True, True]] and unknown.signed.tolist() == [
        [False, False],
        [True, True],
    ]
    assert not Unknown("P", (2, 2), "symmetric").signed.any() and Unknown("P", (2, 2), "symmetric").is_symmetric
    assert Unknown("N", (2, 2), "symmetric_nonnegative").signed.all() and not Unknown("w", (2,), "free").is_symmetric


@pytest.mark.parametrize(("units", "multiplier"), CASES)
def test_fractions_and_bounded_floats_read_the_same(units, multiplier):
    loop, rng = loop_of(units)
    wide = multiplier.step(loop)
    values = md.drawn_values(rng, multiplier, wide)
    read = {kind: multiplier.step(loop.read(kind)) for kind in (Rational, Rounded)}
    lifted = {kind: {name: kind.lift(value) for name, value in values.items()} for kind in read}
    for form in (multiplier.matrix, lambda *given: multiplier.signs(*given)):
        plain, exactly, rounded = form(wide, values), *(form(read[kind], lifted[kind]) for kind in (Rational, Rounded))
        for one, true, bounded in zip(*map(as_list, (plain, exactly, rounded)), strict=True):
            true_floats = true.fractions().astype(float)
            np.testing.assert_allclose(one, true_floats, atol=1e-11 * (1 + np.abs(true_floats).max()))
            gap = Rational.lift(bounded.value).fractions() - true.fractions()
            assert np.all(np.abs(gap) <= Rational.lift(bounded.error).fractions())
            assert np.all(bounded.error <= 1e-11 * (1 + bounded.size))


def as_list(found):
    return list(found.values()) if isinstance(found, dict) else [found]


@pytest.mark.parametrize(("units", "multiplier"), CASES)
def test_cvxpy_and_casadi_read_the_same(units, multiplier):
    import casadi as ca
    import cvxpy as cp

    loop, rng = loop_of(units)
    wide = multiplier.step(loop)
    values = md.drawn_values(rng, multiplier, wide)
    searched = {name: cp.Constant(value) for name, value in values.items()}
    symbols = {name: ca.SX.sym(name, *value.shape) for name, value in values.items()}
    for form in (multiplier.matrix, multiplier.signs):
        plain = as_list(form(wide, values))
        if not plain:
            continue
        for one, other in zip(plain, as_list(form(wide, searched)), strict=True):
            np.testing.assert_allclose(other.value, one, atol=1e-12)
        outputs = [ca.SX(out) for out in as_list(form(wide, symbols))]
        at = ca.Function("M", list(symbols.values()), outputs).call([ca.DM(value) for value in values.values()])
        for one, other in zip(plain, at, strict=True):
            np.testing.assert_allclose(other.full(), one, atol=1e-12)


@pytest.mark.parametrize("multiplier", [Sector(), Slope(), Relu()])
def test_casadi_differentiates_in_the_controller(multiplier):
    import casadi as ca

    loop, rng = loop_of("kinked and curved")
    wide = multiplier.step(loop)
    values = md.drawn_values(rng, multiplier, wide)
    symbol = ca.SX.sym("Z", *wide.Z.shape)
    M = multiplier.matrix(replace(wide, Z=symbol, parts=None), values)
    found = ca.Function("M", [symbol], [M])(wide.Z).full()
    np.testing.assert_allclose(found, multiplier.matrix(wide, values), atol=1e-12)


@pytest.mark.parametrize(("units", "multiplier"), CASES)
def test_another_frame_scales_every_column_that_it_is_asked_to(units, multiplier):
    # Coordinates x~ = T x, eta~ = eta / sizes, at every step, and the columns of kinks like the unit that they belong to.
    from inc_casadi.lmi_frame import Frame

    loop, rng = loop_of(units, 22)
    wide = multiplier.step(loop)
    frame = Frame(rng.normal(size=(loop.n, loop.n)), 10.0 ** rng.uniform(-2, 2, size=loop.q))
    S = frame.congruence(wide)
    assert S.shape == (wide.width, wide.width)
    np.testing.assert_allclose(frame.T @ wide.X[: loop.n] @ S, np.eye(loop.n, wide.width), atol=1e-9)
    np.testing.assert_allclose(wide.H @ S, np.diag(frame.sizes[list(wide.units)]) @ wide.H, atol=1e-12)
    if wide.atoms:
        np.testing.assert_allclose(S[-len(wide.atoms) :, -len(wide.atoms) :], np.diag(frame.sizes[list(wide.atoms)]))
