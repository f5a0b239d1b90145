"""prop:projected_training_wp: the row-wise projection is the nearest point of the ball, and every iterate is well posed."""

import numpy as np
import pytest

from inc_casadi import INC, Box, Plant, ReLU, Spec
from synthesis.ball import project_rows
from synthesis.training import train


def corners(columns, kappa):
    """The extreme points of the l1 ball of radius kappa in R^columns."""
    return kappa * np.concatenate([np.eye(columns), -np.eye(columns)])


@pytest.mark.parametrize("kappa", [0.5, 0.95])
def test_the_projection_is_the_nearest_matrix_of_the_ball(kappa):
    # Row by row: w* in the ball is nearest to w iff (w - w*)'(c - w*) <= 0 for every extreme point c of the ball.
    W = np.random.default_rng(51).normal(size=(40, 6)) * np.geomspace(0.01, 5, 40)[:, None]
    found = project_rows(W, kappa)
    assert np.all(np.abs(found).sum(axis=1) <= kappa)
    products = np.einsum("rc,rkc->rk", W - found, corners(6, kappa)[None] - found[:, None])
    assert np.max(products) <= 1e-12
    inside = np.abs(W).sum(axis=1) <= kappa
    assert 0 < inside.sum() < 40 and np.array_equal(found[inside], W[inside])


def test_the_radius_is_below_kappa_after_projection():
    W = 10 * np.random.default_rng(52).normal(size=(7, 7))
    assert np.max(np.abs(np.linalg.eigvals(np.abs(W)))) > 1
    assert np.max(np.abs(np.linalg.eigvals(np.abs(project_rows(W, 0.9))))) <= 0.9 + 1e-12


@pytest.mark.parametrize("steps", ["spectral", "adam"])
def test_every_law_of_a_training_is_well_posed(steps, monkeypatch):
    from synthesis import projected

    seen = []
    original = projected._Space.law

    def watched(self, x):
        law = original(self, x)
        seen.append(law[0])
        return law

    monkeypatch.setattr(projected._Space, "law", watched)
    spec = Spec(np.eye(2), 0.1, 0.95, Box([-1, -1], [1, 1]))
    rng = np.random.default_rng(53)
    W = rng.normal(size=(3, 3))
    start = INC(0.29 * W / np.abs(W).sum(axis=1).max(), rng.normal(size=(3, 2)), 0.3 * rng.normal(size=(1, 3)),
                [[-0.3, -0.5]], activation=ReLU())
    kappa = 0.3
    trained = train(Plant([[1.0, 0.4], [0.0, 1.0]], [[0.1], [0.5]]), spec, start, kappa=kappa, form="projected", steps=steps,
                    max_iterations=12, horizon=10)
    norms = np.array([np.abs(W).sum(axis=1).max() for W in seen])
    assert len(seen) > 5 and np.all(norms <= kappa) and norms.max() > 0.9 * kappa
    assert np.abs(trained.inc.W).sum(axis=1).max() <= kappa and trained.inc.well_posedness().holds
