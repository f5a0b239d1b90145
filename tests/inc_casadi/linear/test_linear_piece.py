"""The linear piece of a law: it answers like the law as far as the room says, and no further."""

from fractions import Fraction

import numpy as np
import pytest

from inc_casadi import INC, Box, LeakyReLU, ReLU, Saturation, Tanh
from inc_casadi.blocks import exact
from inc_casadi.linear.linear_piece import MOST_UNITS, linear_piece


def implicit():
    """A law with W full, mixed units and biases, that is zero at y = 0: unit 2 is flat there."""
    W = np.array([[0.25, -0.125, 0.0], [0.5, 0.0, 0.25], [0.0, 0.125, -0.25]])
    U, V = np.array([[1.0, -0.5], [0.25, 2.0], [0.5, 0.5]]), np.array([[1.0, -2.0, 0.5]])
    eta = np.array([1.0, -0.25, 1.0])  # of leaky ReLU, saturation, saturation, all held exactly
    z = np.array([1.0, -0.25, 1.5])
    return INC(W, U, V, [[0.25, -1.0]], z - W @ eta, -V @ eta, (LeakyReLU(0.5), Saturation(), Saturation()))


def test_on_its_piece_the_law_is_the_gain():
    law = implicit()
    piece = linear_piece(law)
    K = piece.K.astype(float)
    assert not any(piece.u_0)
    y = 0.05 * np.random.default_rng(0).uniform(-1, 1, (2, 50))
    assert law(y) == pytest.approx(K @ y, abs=1e-12)
    assert K == pytest.approx(law.jacobian(np.zeros(2)), abs=1e-12)


def test_units_switch_where_the_room_ends():
    law = implicit()
    piece, met = linear_piece(law), 0
    Z = piece.Z.astype(float)
    for i, ends in enumerate(piece.room):
        for end in (float(end) for end in ends if end is not None):
            y = Z[i] / (Z[i] @ Z[i]) * end  # Z_i y = end
            if any(not (low is None or low < z) or not (high is None or z < high)
                   for k, ((low, high), z) in enumerate(zip(piece.room, Z @ y, strict=True)) if k != i):
                continue  # another unit has switched before
            before, after = (law.W @ law.hidden(t * y) + law.U @ (t * y) + law.b for t in (0.999, 1.001))
            unit = law.activations[i].pieces
            assert unit.index(before[i]) != unit.index(after[i])
            met += 1
    assert met >= 2


def test_the_room_counts_from_where_each_unit_rests():
    room = [(Fraction(-1), None), (Fraction(-3, 4), Fraction(5, 4)), (Fraction(-1, 2), None)]
    assert linear_piece(implicit()).room == room


def test_a_law_without_units_has_its_gain_and_no_limits():
    piece = linear_piece(INC.linear([[0.1, 2.0]]))
    assert np.array_equal(piece.K, exact(np.array([[0.1, 2.0]]))) and piece.room == []


def test_idle_units_do_not_count():
    law = INC(np.zeros((1, 1)), [[5.0]], [[0.0]], [[0.3]])
    assert linear_piece(law).room == []


@pytest.mark.parametrize("law, reason", [
    (INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=Tanh()), "unit 0 is curved"),
    (INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], activation=ReLU()), "unit 0 rests on a kink"),
    (INC.saturated(np.ones((MOST_UNITS + 1, 1)), 1.0), f"it has {MOST_UNITS + 1} hidden units")])
def test_what_has_no_linear_piece_says_why(law, reason):
    assert reason in linear_piece(law)


def test_a_clipped_law_off_the_middle_of_its_limits_is_linear_too():
    piece = linear_piece(INC.linear([[2.0]]).with_saturated_output(Box(-1.0, 3.0)))
    assert piece.K.tolist() == [[2]] and piece.room == [(Fraction(-1, 2), Fraction(3, 2))]


@pytest.mark.parametrize("law", [INC([[0.0]], [[1.0]], [[1.0]], [[0.0]], b=[0.5]),
                                 INC(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[1.0]], d=[0.5])])
def test_the_input_at_zero_is_told(law):
    assert linear_piece(law).u_0.tolist() == [Fraction(1, 2)]
