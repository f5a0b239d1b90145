"""prop:pwa_relu: continuous piecewise-affine laws written as ReLU controllers, compared with their definition."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Polytope, ReLU

SQUARE = np.stack(np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))).reshape(2, -1)


def triangles(values):
    """The law on [-1, 1]^2 that is affine on four triangles around the origin, 0 there, `values` (m, 4) at the corners."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    pieces = []
    for i in range(4):
        a, b = corners[i], corners[(i + 1) % 4]
        gain = np.linalg.solve(np.stack([a, b]), values[:, [i, (i + 1) % 4]].T).T
        pieces.append((Polytope.from_vertices(np.stack([np.zeros(2), a, b], axis=1)), gain, np.zeros(len(values))))
    return pieces


def on_triangles(values, points):
    """The same law, evaluated triangle by triangle in barycentric coordinates."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    out = np.full((len(values), points.shape[1]), np.nan)
    for i in range(4):
        weights = np.linalg.solve(np.stack([corners[i], corners[(i + 1) % 4]], axis=1), points)
        here = np.all(weights >= -1e-12, axis=0)
        out[:, here] = values[:, [i, (i + 1) % 4]] @ weights[:, here]
    return out


def require_well_posed_relu(inc):
    assert all(unit == ReLU() for unit in inc.activations)
    assert np.max(np.abs(np.linalg.eigvals(inc.W)), initial=0.0) < 1e-12 and inc.contraction.radius < 1e-12


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_law_on_four_triangles(seed):
    values = np.random.default_rng(seed).normal(size=(2, 4))
    inc = INC.from_affine_pieces(triangles(values))
    require_well_posed_relu(inc)
    np.testing.assert_allclose(inc(SQUARE), on_triangles(values, SQUARE), atol=1e-10)


def test_a_law_that_is_neither_convex_nor_concave():
    # max(min(y1, y2), -0.5): its kinks end where they meet, so one hinge for each will not do.
    def piece(rows, h, gain, offset):
        box = [[1, 0], [-1, 0], [0, 1], [0, -1]]
        return Polytope(np.array(box + rows, dtype=float), np.array([1.0] * 4 + h)), [gain], [offset]
    pieces = [piece([[1, -1], [-1, 0]], [0.0, 0.5], [1.0, 0.0], 0.0),
              piece([[-1, 1], [0, -1]], [0.0, 0.5], [0.0, 1.0], 0.0),
              piece([[1, -1], [1, 0]], [0.0, -0.5], [0.0, 0.0], -0.5),
              piece([[-1, 1], [0, 1]], [0.0, -0.5], [0.0, 0.0], -0.5)]
    inc = INC.from_affine_pieces(pieces)
    require_well_posed_relu(inc)
    np.testing.assert_allclose(inc(SQUARE)[0], np.maximum(np.minimum(*SQUARE), -0.5), atol=1e-12)
    assert inc.q == 2  # one unit for the minimum, one for the maximum


def test_the_saturation_of_the_paper_takes_two_units():
    # eq:relu_sat_controller: 1 - relu(1.5 x + 1) + relu(1.5 x - 1) = -sat(1.5 x).
    third = 2 / 3
    pieces = [(Box([-2.0], [-third]), [[0.0]], [1.0]), (Box([-third], [third]), [[-1.5]], [0.0]),
              (Box([third], [2.0]), [[0.0]], [-1.0])]
    inc, x = INC.from_affine_pieces(pieces), np.linspace(-2, 2, 401)[None]
    require_well_posed_relu(inc)
    np.testing.assert_allclose(inc(x), -np.clip(1.5 * x, -1, 1), atol=1e-12)
    assert inc.q == 2


def test_a_jump_is_refused():
    with pytest.raises(ValueError, match="jump"):
        INC.from_affine_pieces([(Box([-1.0], [0.0]), [[1.0]], [0.0]), (Box([0.0], [1.0]), [[1.0]], [0.25])])
