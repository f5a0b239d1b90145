"""Problems off the beaten track end in a state that is true, with cost above every bound, and never in a traceback."""

import numpy as np
import pytest

from inc_casadi import Box, Empirical, Gaussian, Plant, Polytope, Spec, Tanh
from synthesis import synthesize

UNSTABLE, PAIR = Plant([[1.5]], [[1.0]]), Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
UNIT = Box([-1.0], [1.0])


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "spec", "keywords", "status"), [
    (UNSTABLE, Spec([[1.0]], [[0.1]], 1.0, UNIT, UNIT), {}, "certified"),
    (Plant([[1.2]], [[1.0]]), Spec([[1.0]], [[0.1]], 0.95, UNIT, Box([-0.5], [1.3])), {"hidden": 2}, "certified"),
    (Plant([[0.8]], [[1.0]]), Spec([[1.0]], [[0.1]], 0.95, UNIT, Box([0.1], [1.3])), {}, "certified"),
    (Plant(np.diag([1.1, 0.9]), np.eye(2)),
     Spec(np.eye(2), 0.1 * np.eye(2), 0.95, Box([-1.0, -1.0], [1.0, 1.0]),
          Polytope([[1, 1], [1, -1], [-1, 1], [-1, -1]], [1.0] * 4)), {}, "certified"),
    (PAIR, Spec(np.eye(2), [[0.05]], 0.98, Polytope.from_vertices([[0, 0.5, -0.3], [0.4, -0.2, -0.3]]), UNIT), {},
     "certified"),
    (PAIR, Spec(np.eye(2), [[0.05]], 0.98, Empirical([[0.1, 0.3, -0.2], [0.2, 0, -0.3]]), UNIT), {}, "certified"),
    (PAIR, Spec(np.eye(2), [[0.05]], 0.98, Box([-0.8, -0.8], [0.8, 0.8]), UNIT), {"hidden": 3, "activation": Tanh()},
     "certified"),
    (Plant([[1.1]], [[1.0]]), Spec([[1.0]], [[0.05]], 0.98, Gaussian([0.0], [[0.1]])), {}, "certified"),
    (Plant([[0.9]], [[1.0]]), Spec([[0.0]], [[1.0]], 0.98, UNIT, UNIT), {}, "certified"),
    (Plant([[1.1]], [[1e-6]]), Spec([[1e12]], [[1e-3]], 0.98, Box([-1e-6], [1e-6]), UNIT), {}, "certified"),
    (UNSTABLE, Spec([[1.0]], [[0.0]], 0.9, Box([-2.0], [2.0]), UNIT), {}, "simulation evidence"),
    (Plant([[1.1]], [[1.0]]), Spec([[0.0]], [[0.0]], 0.98, UNIT, UNIT), {}, "failed"),
], ids=["discount 1", "uneven limits", "limits without zero", "diamond", "triangle", "points", "tanh", "normal", "Q = 0",
        "tiny units", "edge of controllability", "no cost at all"])
def test_state_and_order_of_costs(plant, spec, keywords, status):
    result = synthesize(plant, spec, verbose=False, training_seconds=3.0, **{"hidden": 0} | keywords)
    assert result.status == status
    assert str(result).splitlines()[0].lower().endswith(status)
    assert all(bound.holds() for bound in result.bounds.values())
    assert float(result.bounds["any controller"]) <= result.cost * (1 + 1e-9)
    if status == "certified":
        assert result.proof, result.proof.reason
        assert result.estimate.mean <= result.cost + 5 * result.estimate.standard_error
