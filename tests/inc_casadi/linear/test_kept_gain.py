"""The best gain that keeps its limits at all times: slopes against differences, limits on motions, published figures."""

from dataclasses import replace

import numpy as np
import pytest

from inc_casadi import INC, Box, Ellipsoid, Plant, Polytope, Spec, Uniform, simulate
from inc_casadi.errors import InfeasibleError, InvalidInputError
from inc_casadi.linear import LinearController, best_static_gain, linear_cost
from inc_casadi.linear.kept_gain import WATCHED, _judged, _share_slopes, best_kept_gain, shares

PLANT = Plant([[1.0, 0.3, 0.0], [-0.2, 0.9, 0.2], [0.1, 0.0, 0.7]], [[0.0, 0.2], [0.5, 0.0], [0.1, 0.6]],
              [[1.0, 0.0, 0.2], [0.0, 1.0, 0.0]])
SPEC = Spec(np.diag([1.0, 2.0, 0.5]), np.diag([0.1, 0.2]), 0.97, Box([-1.0, -0.8, -0.5], [0.9, 1.0, 0.7]),
            Box([-0.5, -0.6], [0.6, 0.4]))
LATE = Plant([[0.8, 0.0, 1.0], [0.5, 0.8, 0.0], [0.0, 0.5, 0.5]], [[0.0], [0.0], [1.0]])  # the largest input comes later
LATE_SPEC = Spec(np.diag([1.0, 1.0, 0.1]), 0.01, 0.95, Box([-0.1, -0.1, -1.0], [0.1, 0.1, 1.0]), Box(-0.5, 0.5))
GAIN = np.array([[-0.3, -0.4], [0.1, -0.2]])


@pytest.mark.parametrize("initial", [SPEC.initial, Uniform(Ellipsoid(np.diag([1.0, 2.0, 3.0]), [0.1, 0.0, -0.1])),
                                     Uniform(Polytope.from_vertices(SPEC.initial.vertices[:, :5]))])
def test_shares_are_the_largest_over_the_motions(initial):
    asked = replace(SPEC, initial=initial)
    x = initial.sample(4000, np.random.default_rng(0))
    x = x if isinstance(initial.support, Ellipsoid) else np.hstack([x, initial.vertices])
    u = simulate(PLANT, INC.linear(GAIN), x, steps=5).u[..., :5]
    seen = np.einsum("fm,mnk->kfn", SPEC.inputs.H / SPEC.inputs.h[:, None], u).max(axis=2)
    found = shares(PLANT, asked, GAIN, 5)
    assert np.all(seen <= found + 1e-12) and np.all(found <= seen + 0.1)


def test_slopes_are_those_of_differences():
    steps = 1e-6 * np.eye(GAIN.size)
    differences = np.stack([(shares(PLANT, SPEC, GAIN + step.reshape(2, 2)) - shares(PLANT, SPEC, GAIN - step.reshape(2, 2)))
                            .ravel() / 2e-6 for step in steps], axis=1)
    found = _share_slopes(PLANT, SPEC, GAIN)
    assert found.shape == (WATCHED * 4, 4) and found == pytest.approx(differences, abs=1e-6)


def test_it_keeps_the_limits_where_the_first_move_alone_does_not():
    first, found = best_static_gain(LATE, LATE_SPEC), best_kept_gain(LATE, LATE_SPEC)
    kept = [float(np.max(shares(LATE, LATE_SPEC, F, 60))) for F in (first.F, found.controller.D_c)]
    assert kept[0] > 1.2 and kept[1] <= 1 and found.prove()
    assert first.cost < found.bound < 1.05 * first.cost


def test_no_gain_nearby_is_cheaper_and_kept():
    found, rng, tried = best_kept_gain(LATE, LATE_SPEC), np.random.default_rng(1), 0
    for _ in range(200):
        F = found.controller.D_c + 0.02 * rng.standard_normal((1, 3))
        if np.max(shares(LATE, LATE_SPEC, F, 60)) <= 1:
            cost = linear_cost(LATE, replace(LATE_SPEC, inputs=None), LinearController.static(F)).cost
            assert cost >= found.bound * (1 - 1e-4)
            tried += 1
    assert tried > 10


def test_the_published_gain_of_two_states():
    from benchmarks.plants import two_state
    plant, spec, _ = two_state()
    found = best_kept_gain(plant, spec)
    assert found.bound == pytest.approx(3.3472, abs=1e-4)
    assert found.controller.D_c == pytest.approx(np.array([[-0.3535, -0.8965]]), abs=1e-4)


def test_without_limits_it_is_the_best_gain():
    free = replace(SPEC, inputs=None)
    assert best_kept_gain(PLANT, free).bound == pytest.approx(best_static_gain(PLANT, free).cost, rel=1e-8)


def test_no_time_still_gives_a_gain_that_is_proved():
    assert best_kept_gain(PLANT, SPEC, seconds=0.0).holds()


def test_where_no_gain_is_kept_it_says_so():
    with pytest.raises(InfeasibleError, match="at all times"):
        best_kept_gain(Plant([[1.2, 1.0], [0.0, 1.2]], [[0.0], [1.0]]), Spec(np.eye(2), 1.0, 0.9, Box([-1, -1], [1, 1]),
                                                                           Box(-0.5, 0.5)))
    with pytest.raises(InvalidInputError, match="continuous"):
        best_kept_gain(Plant(-1.0, 1.0, dt=0), Spec(1.0, 1.0, 1.0, Box(-1, 1)))


def test_only_what_is_proved_is_taken():
    assert _judged(PLANT, SPEC, 5 * GAIN) is None and _judged(PLANT, SPEC, np.full((2, 2), np.nan)) is None
