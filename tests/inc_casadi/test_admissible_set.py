"""Maximal output-admissible sets against simulation from many points, against sets known by hand, and their exact proof."""

from dataclasses import replace

import draws
import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, Polytope, ReLU, Saturation
from inc_casadi.admissible_set import admissible_set, is_invariant, maximal_admissible_set
from inc_casadi.errors import DimensionError, EmptySetError, InvalidInputError
from inc_casadi.loop import equilibrium


def system(seed, n, radius=0.93):
    rng = np.random.default_rng(seed)
    A = draws.plant(rng, n=n, m=1, p=1, radius=radius).A
    H = rng.normal(size=(n + 1, n))
    H = np.vstack([H, -H.sum(axis=0)])  # the rows span positively, so the set is bounded
    return A, H, rng.uniform(0.5, 2.0, size=len(H))


def keeps(A, H, h, x, steps=400):
    """Which of the columns x keep H x <= h over the steps."""
    inside = np.ones(x.shape[1], dtype=bool)
    for _ in range(steps):
        inside &= np.all(H @ x <= h[:, None], axis=0)
        x = A @ x
    return inside


@pytest.mark.parametrize("n, seed", [(2, 0), (2, 1), (3, 2), (4, 3)])
def test_the_set_is_where_simulated_motions_keep_their_constraints(n, seed):
    A, H, h = system(seed, n)
    found = maximal_admissible_set(A, H, h)
    assert found.steps > 0 and found.prove()
    rng = np.random.default_rng(seed + 50)
    x = 1.3 * found.polytope.vertices.max() * rng.uniform(-1, 1, size=(n, 20_000))
    margin = np.max((found.polytope.H @ x) / found.polytope.h[:, None], axis=0)  # 1 on the boundary, the origin is inside
    clear = np.abs(margin - 1) > 1e-6
    np.testing.assert_array_equal(keeps(A, H, h, x)[clear], (margin < 1)[clear])
    assert (margin < 1).sum() > 100


@pytest.mark.parametrize("n, seed", [(2, 5), (3, 6)])
def test_the_set_is_maximal_up_to_a_billionth(n, seed):
    A, H, h = system(seed, n)
    vertices = maximal_admissible_set(A, H, h).polytope.vertices
    assert keeps(A, H, h, vertices).all()
    assert not keeps(A, H, h, vertices * (1 + 1e-7)).any()


def test_a_set_by_hand():
    # |x1| <= 1 and then |x1 / 2 + x2| <= 1 and |x1 / 4 + x2| <= 1; the next row follows.
    found = maximal_admissible_set([[0.5, 1.0], [0.0, 0.5]], [[1.0, 0.0], [-1.0, 0.0]], [1.0, 1.0])
    corners = np.array([[-1.0, 1.25], [0.0, 1.0], [1.0, 0.5], [1.0, -1.25], [0.0, -1.0], [-1.0, -0.5]])
    for corner in corners:
        assert np.abs(found.polytope.vertices.T - corner).max(axis=1).min() < 1e-8
    assert found.polytope.vertices.shape == (2, 6) and found.steps == 2


def test_the_proof_refuses_a_larger_set_and_other_constraints():
    A, H, h = system(8, 3)
    found = maximal_admissible_set(A, H, h)
    larger = replace(found, polytope=Polytope(found.polytope.H, found.polytope.h * (1 + 1e-6)))
    assert found.prove() and "constraint" in larger.prove().reason
    assert "constraint" in replace(found, h=h * (1 - 1e-6)).prove().reason
    turned = replace(found, A=1.5 * A)
    assert not turned.prove() and "one step on" in turned.prove().reason
    moved = replace(found, c=np.array([10.0, 0.0, 0.0]))
    assert not moved.prove() and "one step on" in moved.prove().reason


def test_invariance_is_decided_at_the_last_digit():
    square = Polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    assert is_invariant(square, [[0.5, 0.5], [0.0, 1.0]])
    assert not is_invariant(square, [[0.5, 0.5 + 2**-50], [0.0, 1.0]])
    assert is_invariant(square, [[0.5, 0.25], [0.0, 0.5]], [0.25, 0.5])
    assert not is_invariant(square, [[0.5, 0.25], [0.0, 0.5]], [0.25, 0.5 + 2**-50])


def test_motions_that_end_elsewhere_than_at_the_origin():
    A = np.array([[1.0, 0.3], [0.0, 0.5]])  # x ends at (x1 + 0.6 x2, 0)
    H, h = np.vstack([np.eye(2), -np.eye(2)]), np.ones(4)
    found = maximal_admissible_set(A, H, h)
    assert keeps(A, H, h, found.polytope.vertices * (1 - 1e-9)).all()
    assert found.polytope.support([1.0, 0.6]) == pytest.approx(0.999, abs=1e-8)
    # The maximal set is the square cut at |x1 + 0.6 x2| <= 1, which takes two triangles of area 0.3 off.
    assert found.polytope.volume == pytest.approx(3.4, rel=1e-3)
    x = np.random.default_rng(0).uniform(-1.2, 1.2, size=(2, 20_000))
    missed = keeps(A, H, h, x) & ~found.polytope.contains(x)
    assert missed.mean() < 2e-3 and not np.any(found.polytope.contains(x) & ~keeps(A, H, h, x, 2000))


def test_what_is_refused():
    square = np.vstack([np.eye(2), -np.eye(2)])
    with pytest.raises(InvalidInputError, match="not stable: its spectral radius is 1.1"):
        maximal_admissible_set(np.diag([1.1, 0.5]), square, np.ones(4))
    with pytest.raises(InvalidInputError, match="not stable"):
        maximal_admissible_set([[0.0, 1.0], [-1.0, 0.0]], square, np.ones(4))
    with pytest.raises(InvalidInputError, match="not stable"):
        maximal_admissible_set([[1.0, 1.0], [0.0, 1.0]], square, np.ones(4))
    with pytest.raises(InvalidInputError, match=r"h\[2\] = 0"):
        maximal_admissible_set(np.diag([0.5, 0.5]), square, [1.0, 1.0, 0.0, 1.0])
    with pytest.raises(EmptySetError, match="unbounded"):
        maximal_admissible_set(np.diag([0.5, 0.4]), [[1.0, 0.0], [-1.0, 0.0]], [1.0, 1.0])
    with pytest.raises(DimensionError, match="square"):
        maximal_admissible_set(np.ones((2, 3)), square, np.ones(4))


UNSTABLE = Plant([[1.1, 0.4], [0.0, 0.9]], [[0.1], [0.7]])
GAIN = np.array([[-0.9, -0.8]])


def test_a_saturated_law_has_the_set_of_its_linear_law_within_the_limit():
    by_gain = admissible_set(UNSTABLE, GAIN, Box([-1.5], [1.5]))
    by_kinks = admissible_set(UNSTABLE, INC.saturated(GAIN, 1.5), None)
    assert by_gain.prove() and by_kinks.prove()
    for direction in np.random.default_rng(1).normal(size=(20, 2)):
        assert by_kinks.polytope.support(direction) == pytest.approx(by_gain.polytope.support(direction), rel=1e-7)
    cut = admissible_set(UNSTABLE, GAIN, Box([-1.5], [1.5]), Box([-1.0, -9.0], [9.0, 9.0]))
    assert cut.polytope.volume < 0.95 * by_gain.polytope.volume and cut.prove()


def biased_law():
    """Implicit, biased, mixed units, well posed; its equilibrium is not the origin and on no kink."""
    law = INC.saturated(GAIN, 2.0)
    W = np.array([[0.0, 0.2], [0.3, 0.0]])
    U = np.vstack([law.U, [[0.3, -0.2]]])
    return INC(W, U, np.hstack([law.V, [[0.1]]]), law.K, [0.1, -0.4], [0.05], (Saturation(), ReLU()))


def test_a_biased_implicit_law_stays_on_its_pieces():
    inc = biased_law()
    rest = equilibrium(UNSTABLE, inc)
    found = admissible_set(UNSTABLE, inc, Box([-1.8], [1.9]))
    assert np.abs(rest.x).max() > 0.05 and found.polytope.contains(rest.x) and found.prove()
    x = found.polytope.sample(300, np.random.default_rng(3))
    slope = inc.jacobian(rest.x)
    for _ in range(60):
        u = inc(x)
        np.testing.assert_allclose(u, rest.u[:, None] + slope @ (x - rest.x[:, None]), atol=1e-9)
        assert u.min() >= -1.8 and u.max() <= 1.9
        x = UNSTABLE.A @ x + UNSTABLE.B @ u
    assert np.abs(x - rest.x[:, None]).max() < 1e-2
    # Beyond each facet, a motion leaves its piece or a limit: the set is not merely some set.
    beyond = rest.x[:, None] + (found.polytope.vertices - rest.x[:, None]) * 1.001
    left = np.zeros(beyond.shape[1], dtype=bool)
    for _ in range(60):
        u = inc(beyond)
        left |= np.abs(u - rest.u[:, None] - slope @ (beyond - rest.x[:, None]))[0] > 1e-7
        left |= (u[0] < -1.8) | (u[0] > 1.9)
        beyond = UNSTABLE.A @ beyond + UNSTABLE.B @ u
    assert left.all()


def test_an_equilibrium_on_a_kink_or_limit_is_refused():
    with pytest.raises(EmptySetError, match="a kink"):
        admissible_set(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[-0.2]], [[0.0]]), Box([-1.0], [1.0]))
    with pytest.raises(EmptySetError, match="an input limit"):
        admissible_set(Plant([[0.5]], [[1.0]]), [[-0.2]], Box([0.0], [1.0]))
    with pytest.raises(EmptySetError, match="a state limit"):
        admissible_set(Plant([[0.5]], [[1.0]]), [[-0.2]], None, Box([0.5], [1.0]))
    with pytest.raises(DimensionError, match="inputs is a set in R"):
        admissible_set(UNSTABLE, GAIN, Box([-1.0, -1.0], [1.0, 1.0]))
