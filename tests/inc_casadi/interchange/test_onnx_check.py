"""The comparison of a translated network with its original: what differs by more than rounding is refused."""

import numpy as np
import pytest

from inc_casadi import INC, ReLU
from inc_casadi.errors import TranslationError
from inc_casadi.interchange.onnx_check import check_answers, sample_points

RNG = np.random.default_rng(7)
A, C, ROW, PAIR = RNG.normal(size=(3, 4)), RNG.normal(size=(4, 2)), RNG.normal(size=4), RNG.normal(size=2)
LAW = INC.from_layers([(A.T, ROW), (C.T, PAIR)], ReLU())


def answers(law):
    return lambda y: law(y.astype(float)).astype(y.dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_same_network_passes(dtype):
    majorant = INC(np.abs(LAW.W), np.abs(LAW.U), np.abs(LAW.V), np.abs(LAW.K), np.abs(LAW.b), np.abs(LAW.d))
    assert check_answers(LAW, majorant, answers(LAW), 5, np.dtype(dtype)) < 0.5


@pytest.mark.parametrize("part", ["U", "V", "b", "d", "K"])
def test_a_number_that_is_off_is_found(part):
    values = {name: getattr(LAW, name).copy() for name in ("W", "U", "V", "K", "b", "d")}
    values[part].flat[0] += 3e-3
    wrong = INC(**values)
    majorant = INC(*(np.abs(values[name]) for name in ("W", "U", "V", "K", "b", "d")))
    with pytest.raises(TranslationError, match="differ by more than rounding"):
        check_answers(wrong, majorant, answers(LAW), 5, np.dtype(np.float32))


def test_kinks_are_looked_at():
    """A unit's kink is found although no random point falls near it."""
    narrow = INC(np.zeros((2, 2)), [[1e6], [1e6]], [[1.0, -1.0]], [[0.0]], b=[-3e5, -3e5 - 1.0])
    flat = INC(np.zeros((2, 2)), [[1e6], [1e6]], [[0.0, 0.0]], [[0.0]], b=[-3e5, -3e5 - 1.0], d=[0.5])
    z = narrow.U @ sample_points(narrow, 60, 0) + narrow.b[:, None]
    assert np.all(np.min(np.abs(z), axis=1) < 1e-6)
    with pytest.raises(TranslationError):
        check_answers(flat, flat, answers(narrow), 1, np.dtype(float))


def test_no_answer_is_not_the_right_answer():
    law = INC.linear([[1.0]])
    with pytest.raises(TranslationError):
        check_answers(law, law, lambda y: np.full(1, np.nan), 1, np.dtype(float))
    with pytest.raises(TranslationError, match="answers with 2 values"):
        check_answers(law, law, lambda y: np.zeros(2), 1, np.dtype(float))
