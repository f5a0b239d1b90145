"""Refinement against the clock: whenever it runs out, what was proved by then stays proved."""

import numpy as np
import pytest

from inc_casadi import Box, Plant, Spec
from inc_casadi.bounds import refinement
from inc_casadi.bounds.any_controller import expected
from inc_casadi.bounds.partition import partition
from inc_casadi.bounds.refinement import Search, refined
from inc_casadi.bounds.value_iteration import value_iteration

PLANT = Plant([[1.10, 1.00], [0.0, 1.02]], [[0.20], [0.50]])
SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))
STEPS = 60


class Ends:
    """A clock that is over from its n-th look on."""

    is_set, left = True, 1e6

    def __init__(self, looks):
        self.looks = looks

    @property
    def is_over(self):
        self.looks -= 1
        return self.looks < 0


def value(looks):
    P, K = value_iteration(PLANT, SPEC, STEPS)
    search = Search(PLANT, SPEC, P, K, 10, 20, Ends(looks))
    found = refined(search, partition(SPEC.initial, 30, P[STEPS]), 400, 0.0)
    return expected(SPEC, P[STEPS], found.cells, found.values)[0]


@pytest.mark.slow
def test_the_longer_the_clock_runs_the_more_is_proved(monkeypatch):
    monkeypatch.setattr(refinement, "_SMALL", 2**12)  # several looks in each round
    proved = [value(looks) for looks in range(0, 60)]
    assert np.all(np.diff(proved) >= -1e-12) and len(set(proved)) > 4
    assert proved[0] < proved[-1] and proved[-1] == pytest.approx(value(10**9), rel=0.05)
