"""The variables of a law keep W within its norm, whatever the solver returns."""

import numpy as np
import pytest
from bmi_draws import draw

from inc_casadi import ReLU
from synthesis.law_family import family, flat
from synthesis.law_variables import law_of, law_start


@pytest.fixture
def laws():
    """A family in which the middle column of W is frozen."""
    plant, inc, _ = draw(2, 1, 1, 3, ReLU(), seed=1)
    mask = np.zeros((3, 3), dtype=bool)
    mask[:, 1] = True
    return family(plant, inc, kappa=0.8, frozen={"W": mask, "K": True})


def test_start_stands_for_its_own_law_with_room_on_both_sides(laws):
    x, low, high = law_start(laws, 0.3)
    assert flat(law_of(laws, x)) == pytest.approx(flat(laws.start), abs=1e-15)
    assert np.all(low < x) and np.all(x < high)


def test_parts_of_w_are_never_negative_however_wide_the_region(laws):
    _, low, high = law_start(laws, 100.0)
    count = int(laws.free[:9].sum())
    assert np.all(low[: 2 * count] == 0.0) and np.all(low[2 * count:] < -50) and np.all(high > 50)


def test_a_w_that_is_too_large_shrinks_to_the_norm_and_frozen_entries_stay(laws):
    x, _, _ = law_start(laws, 0.3)
    found = law_of(laws, x + 5.0 * np.arange(x.size))
    norms = np.abs(found.W).sum(axis=1)
    assert np.all(norms <= 0.8) and norms == pytest.approx(0.8)
    assert np.array_equal(found.W[:, 1], laws.start.W[:, 1]) and np.array_equal(found.K, laws.start.K)
