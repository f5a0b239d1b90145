"""The exact answer at y = 0, against Picard iteration and by hand."""

from fractions import Fraction

import draws
import numpy as np
import oracles
import posed
import pytest

from inc_casadi import INC, LeakyReLU, ReLU, Saturation, Tanh
from inc_casadi.errors import NotWellPosedError
from inc_casadi.rest import rest_output


@pytest.mark.parametrize("seed", range(5))
def test_agrees_with_picard_on_implicit_piecewise_affine_controllers(seed):
    rng = np.random.default_rng(seed)
    units = (ReLU(), Saturation(), LeakyReLU(0.3), Saturation(), ReLU())
    inc = draws.controller(rng, units=units, gain=1.0, norm=0.9, bias=1.5)
    found = rest_output(inc)
    assert {type(entry) for entry in found} == {Fraction}
    np.testing.assert_allclose(found.astype(float), oracles.control(inc, np.zeros((inc.p, 1)))[:, 0], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_wrong_first_guess_of_the_pieces_is_mended(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    units = (ReLU(), Saturation(), LeakyReLU(0.3), Saturation(), ReLU(), Saturation())
    inc = draws.controller(rng, units=units, gain=1.0, norm=0.9, bias=2.0)
    expected = rest_output(inc)
    monkeypatch.setattr(INC, "hidden", lambda self, y: 30.0 * rng.normal(size=self.q))
    assert rest_output(inc).tolist() == expected.tolist()


def test_exact_where_floats_are_not():
    # eta = relu(eta / 3 + 1) has eta = 3 / 2 only if 1/3 were exact; with the stored double it is 1 / (1 - third).
    inc = INC([[1 / 3]], [[1.0]], [[1.0]], [[0.0]], b=[1.0])
    assert rest_output(inc).tolist() == [1 / (1 - Fraction(1 / 3))]


def test_on_a_kink():
    # z = 1 exactly, where the saturation bends: both pieces give 1.
    inc = INC([[0.0]], [[1.0]], [[2.0]], [[0.0]], b=[1.0], d=[-2.0], activation=Saturation())
    assert rest_output(inc).tolist() == [0]


def test_without_hidden_units_and_without_pieces():
    assert rest_output(INC.linear([[2.0]])).tolist() == [0]
    assert rest_output(INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], b=[1.0], activation=Tanh())) is None


def test_ill_posed_is_refused():
    with pytest.raises(NotWellPosedError):
        rest_output(INC([[2.0]], [[1.0]], [[1.0]], [[0.0]], b=[1.0]))


@pytest.mark.parametrize("seed", range(4))
def test_a_law_posed_by_a_multiplier_rests_where_its_fixed_point_says(seed):
    rng = np.random.default_rng(seed)
    units = (ReLU(), Saturation(), LeakyReLU(0.3), Saturation(), ReLU())
    inc = posed.controller(rng, units, kind=("skew", "symmetric")[seed % 2])
    assert not inc.well_posedness().contracts
    found = rest_output(inc)
    np.testing.assert_allclose(found.astype(float), inc(np.zeros(inc.p)), atol=1e-9)
