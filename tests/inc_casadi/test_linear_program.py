"""Linear programs over half-spaces: value, multipliers, the cases without a maximum, and redundant rows."""

import numpy as np
import pytest

from inc_casadi.linear_program import irredundant, maximum
from inc_casadi.sets import Polytope

SQUARE = np.vstack([np.eye(2), -np.eye(2)])


@pytest.mark.parametrize("seed", range(3))
def test_value_point_and_multipliers_agree(seed):
    rng = np.random.default_rng(seed)
    G = np.vstack([rng.normal(size=(5, 3)), np.eye(3), -np.eye(3)])
    g, row = rng.uniform(0.3, 1.0, size=11), rng.normal(size=3)
    found = maximum(row, G, g)
    assert found.value == pytest.approx(Polytope(G, g).support(row), rel=1e-9)
    assert row @ found.point == found.value and np.all(G @ found.point <= g + 1e-9)
    np.testing.assert_allclose(G.T @ found.multipliers, row, atol=1e-9)
    assert g @ found.multipliers == pytest.approx(found.value, rel=1e-9) and found.multipliers.min() >= 0


def test_without_a_bound_and_without_a_point():
    found = maximum(np.array([1.0, 1.0]), SQUARE[[0, 2]], np.ones(2))
    assert found.value == np.inf and np.isnan(found.point).all()
    assert maximum(np.array([1.0, 0.0]), SQUARE, np.array([-1.0, 1.0, -1.0, 1.0])) is None


def test_rows_that_change_nothing_are_dropped():
    G = np.vstack([SQUARE, [[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]], [[0.0, 1.0]]])
    g = np.array([1.0, 1.0, 1.0, 1.0, 1.5, 1.5, 2.0, 1.0])
    keep = irredundant(G, g, 1e-9)
    assert keep[[0, 2, 3]].all() and keep[[4, 5]].sum() == 1 and not keep[6] and keep[[1, 7]].sum() == 1
    kept, whole = Polytope(G[keep], g[keep]), Polytope(G, g)
    assert kept.volume == pytest.approx(whole.volume, rel=1e-12)


def test_what_cuts_off_less_than_the_tolerance_is_dropped():
    G, g = np.vstack([SQUARE, [[1.0, 1.0]]]), np.array([1.0, 1.0, 1.0, 1.0, 2.0 - 1e-6])
    assert irredundant(G, g, 1e-7).all() and not irredundant(G, g, 1e-5)[4]
