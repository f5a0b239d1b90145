"""The norm-bounded matrix: its form on w = D v, its words, its refusals."""

import numpy as np
import pytest

from inc_casadi import INC, NormBounded, Plant, close_loop
from inc_casadi.errors import DimensionError, InvalidInputError


def test_nonnegative_for_every_matrix_of_the_ball_and_zero_at_its_worst():
    rng = np.random.default_rng(5)
    plant, K = Plant(rng.normal(size=(3, 3)), rng.normal(size=(3, 2))), rng.normal(size=(2, 3))
    for N_u in (rng.normal(size=(4, 2)), None):
        box = NormBounded(rng.normal(size=(3, 2)), rng.normal(size=(4, 3)), N_u, size=0.7)
        loop = close_loop(plant, INC.linear(K)).with_inputs(box.entry(plant))
        N = box.matrix(loop, np.eye(5)[3:], {"tau": np.array([1.5])})
        x = rng.normal(size=3)
        v = box.N_x @ x + (0.0 if N_u is None else N_u @ K @ x)
        for _ in range(50):
            D = rng.normal(size=(2, 4))
            D *= rng.uniform(0, 0.7) / np.linalg.norm(D, 2)
            s = np.concatenate([x, D @ v])
            assert s @ N @ s == pytest.approx(1.5 * (0.49 * v @ v - (D @ v) @ (D @ v))) and s @ N @ s >= 0
        worst = 0.7 * np.outer([0.6, 0.8], v) / np.linalg.norm(v)
        s = np.concatenate([x, worst @ v])
        assert s @ N @ s == pytest.approx(0.0, abs=1e-12 * (v @ v))
        s = np.concatenate([x, 1.01 * worst @ v])
        assert s @ N @ s < 0


def test_words_and_refusals():
    box = NormBounded([[1.0]], [[1.0]], size=1 / 3)
    assert "||D|| <= 0.3333333," in box.words(False) and "dynamic" not in box.words(False)
    assert "stable dynamic ones included" in box.words(True)
    plant = Plant(np.eye(2), np.ones((2, 1)))
    for name, bad in (("E", NormBounded([[1.0]], [[1.0, 2.0]])), ("N_x", NormBounded([[1.0], [1.0]], [[1.0]])),
                      ("N_u", NormBounded([[1.0], [1.0]], [[1.0, 2.0]], [[1.0, 2.0]]))):
        with pytest.raises(DimensionError, match=f"^{name} has shape"):
            bad.check(plant)
    with pytest.raises(InvalidInputError, match="size = -1"):
        NormBounded([[1.0]], [[1.0]], size=-1.0)
    NormBounded([[1.0], [1.0]], [[1.0, 2.0]], [[1.0]], size=0.0).check(plant)
