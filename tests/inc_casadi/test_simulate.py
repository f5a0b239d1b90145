"""Roll-outs against hand cases and closed forms."""

import numpy as np
import pytest
from scipy.linalg import expm

from inc_casadi import INC, Plant, ReLU, simulate
from inc_casadi.errors import DimensionError, InvalidInputError


def test_scalar_law_of_the_paper_reaches_the_origin_in_two_steps():
    law = INC(np.zeros((2, 2)), [[1.5], [1.5]], [[-1.0, 1.0]], [[0.0]], [1.0, -1.0], [1.0], ReLU())
    run = simulate(Plant([[1.5]], [[1.0]]), law, [[1.0, -0.5, 0.75]], steps=3)
    np.testing.assert_allclose(run.x[0], [[1, 0.5, 0, 0], [-0.5, 0, 0, 0], [0.75, 0.125, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(run.u[0], [[-1, -0.75, 0, 0], [0.75, 0, 0, 0], [-1, -0.1875, 0, 0]], atol=1e-15)
    assert run.eta.shape == (2, 3, 4)
    np.testing.assert_allclose(run.cost([[1.0]], [[0.5]], 0.9), [1 + 0.5 + 0.9 * (0.25 + 0.5 * 0.75**2),
                                                                 0.25 + 0.5 * 0.75**2,
                                                                 0.75**2 + 0.5 + 0.9 * (0.125**2 + 0.5 * 0.1875**2)])


def test_linear_motion_agrees_with_matrix_powers_and_exponentials():
    rng = np.random.default_rng(0)
    A, B, C, K = (rng.standard_normal(shape) for shape in ((3, 3), (3, 2), (1, 3), (2, 1)))
    x0 = rng.standard_normal(3)
    run = simulate(Plant(0.3 * A, B, C, dt=0.5), INC.linear(0.1 * K), x0, steps=4)
    closed = 0.3 * A + B @ (0.1 * K) @ C
    np.testing.assert_allclose(run.x[:, 4], np.linalg.matrix_power(closed, 4) @ x0, atol=1e-12)
    assert run.t.tolist() == [0, 0.5, 1, 1.5, 2]
    run = simulate(Plant(A, B, C, dt=0), INC.linear(K), np.stack([x0, -x0], axis=1), times=[0, 0.2, 0.7])
    np.testing.assert_allclose(run.x[:, 0, 2], expm(0.7 * (A + B @ K @ C)) @ x0, rtol=1e-6)
    np.testing.assert_allclose(run.x[:, 1], -run.x[:, 0], rtol=1e-6)
    assert run.u.shape == (2, 2, 3)


def test_continuous_saturated_motion_by_hand():
    run = simulate(Plant([[0.0]], [[1.0]], dt=0), INC.saturated([[-1.0]], 1.0), [3.0], duration=2.0)
    np.testing.assert_allclose(run.x[0], 3.0 - run.t, atol=1e-7)


@pytest.mark.parametrize(("plant", "arguments", "error", "words"), [
    (Plant([[1.0]], [[1.0]]), {"duration": 1.0}, InvalidInputError, "a discrete plant takes steps"),
    (Plant([[1.0]], [[1.0]]), {"steps": -1}, InvalidInputError, "steps = -1 is negative"),
    (Plant([[1.0]], [[1.0]], dt=0), {}, InvalidInputError, "needs a duration or times"),
    (Plant([[1.0]], [[1.0]], dt=0), {"times": [0.0, 2.0, 1.0]}, InvalidInputError, "begin at 0 and increase"),
])
def test_arguments_that_do_not_fit_the_plants_time(plant, arguments, error, words):
    with pytest.raises(error, match=words):
        simulate(plant, INC.linear([[-0.5]]), [1.0], **arguments)


def test_wrong_starting_point_and_cost_in_continuous_time():
    plant = Plant([[1.0]], [[1.0]], dt=0)
    with pytest.raises(DimensionError, match=r"x0 has shape \(2,\)"):
        simulate(plant, INC.linear([[-2.0]]), [1.0, 2.0], duration=1.0)
    with pytest.raises(InvalidInputError, match="sample the plant first"):
        simulate(plant, INC.linear([[-2.0]]), [1.0], duration=1.0).cost([[1.0]], [[1.0]])
