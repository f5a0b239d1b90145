"""The published double integrator under a ReLU net (Everett, Habibi, How; ICRA 2021 and IEEE Access 2021): exact boxes."""

import numpy as np
import oracles
import pytest
from reference import network, reference

from inc_casadi import Box, Plant
from inc_casadi.pieces.reach import reachable

PUBLISHED = {"ReachSDP": 207, "ReachSDP_Partition": 12, "ReachLP": 1590, "ReachLP_Partition": 34}


@pytest.fixture(scope="module")
def problem():
    data = reference("neural_controllers/nflveripy_double_integrator.json")
    start = Box(*np.transpose(data["published"]["X0_box"]))
    return data, Plant(data["plant"]["A"], data["plant"]["B"]), network(data), start


@pytest.mark.parametrize("clipped, area", [(False, 0.004364612748), (True, 0.006066852319)])
def test_exact_boxes_are_those_of_a_million_samples(problem, clipped, area):
    """Published errors are 12 to 1590 times the true area of the last box, in 0.017 to 670 s."""
    data, plant, net, start = problem
    inc = net.with_saturated_output(Box([-1.0], [1.0])) if clipped else net
    sets = reachable(plant, inc, start, 5)
    assert sets.seconds < 0.5 and max(sets.pieces) < 40
    boxes = sets.boxes
    assert np.prod(boxes[5, 1] - boxes[5, 0]) == pytest.approx(area, rel=1e-6)
    if not clipped:
        for k, sampled in enumerate(data["remeasured"]["equilibrium"]["sampled_boxes_t1_5"], start=1):
            np.testing.assert_allclose(boxes[k], [sampled["lo"], sampled["hi"]], atol=1e-9)
    x, _ = oracles.roll_out(plant, inc, start.sample(20_000, np.random.default_rng(0)), 5)
    assert np.all(x[:, :, 5].T >= boxes[5, 0] - 1e-12) and np.all(x[:, :, 5].T <= boxes[5, 1] + 1e-12)
    assert min(PUBLISHED.values()) > 10
