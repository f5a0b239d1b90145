"""One loop in other coordinates, with units permuted, split, idle or rescaled: verdicts and bounds stay, on every rung."""

from dataclasses import replace
from functools import cache

import multiplier_draws as md
import numpy as np
import pytest

from inc_casadi import INC, Gaussian, LeakyReLU, Plant, ReLU, Saturation, Tanh, close_loop
from inc_casadi.claims import DeviationCost, Stability
from inc_casadi.lmi_search import search
from inc_casadi.multipliers import LADDER, Lifted, Relu, Sector, Slope

RELUS = {
    "ReLU": (ReLU(), ReLU(), LeakyReLU(0.3)),
    "saturation": (Saturation(), Saturation()),
    "curved": (Tanh(), Tanh(), md.Lopsided()),
}
RUNGS = {"ReLU": LADDER, "saturation": (Sector(), Slope(), Relu()), "curved": (Sector(), Slope(), Lifted())}


def same_law(units, bias=False):
    """A loop whose cost all rungs bound, small enough to bound it in many forms."""
    rng = np.random.default_rng(7)
    q = len(units)
    W = rng.normal(size=(q, q))
    W *= 0.5 / np.abs(W).sum(axis=1).max()
    A = rng.normal(size=(3, 3))
    plant = Plant(0.7 * A / np.max(np.abs(np.linalg.eigvals(A))), rng.normal(size=(3, 1)), rng.normal(size=(2, 3)))
    inc = INC(
        W,
        rng.normal(size=(q, 2)),
        0.03 * rng.normal(size=(1, q)),
        [[0.02, -0.01]],
        *((rng.normal(size=q), rng.normal(size=1)) if bias else (None, None)),
        units,
    )
    return (
        plant,
        inc,
        DeviationCost(np.diag([1.0, 0.5, 2.0]), [[0.3]], 0.95, Gaussian([1.0, 0.0, -1.0], np.diag([1.0, 2.0, 0.5]))),
    )


def moved(plant, inc, claim):
    """The same loop in coordinates x~ = T x."""
    T = np.array([[1.0, 20.0, 0.0], [0.0, 3.0, 0.1], [0.5, 0.0, 0.01]])
    back = np.linalg.inv(T)
    initial = Gaussian(T @ claim.initial.mean, T @ claim.initial.covariance @ T.T)
    return (
        Plant(T @ plant.A @ back, T @ plant.B, plant.C @ back),
        inc,
        replace(claim, Q=back.T @ claim.Q @ back, initial=initial),
    )


def permuted(plant, inc, claim):
    """The same loop with its units in another order."""
    order = np.roll(np.arange(inc.q), 1)
    units = tuple(inc.activations[i] for i in order)
    return plant, INC(inc.W[np.ix_(order, order)], inc.U[order], inc.V[:, order], inc.K, inc.b[order], inc.d, units), claim


def split(plant, inc, claim):
    """The same loop with its first unit made of two halves."""
    rows = [0, *range(inc.q)]
    halves = np.array([0.5, 0.5, *np.ones(inc.q - 1)])
    units = tuple(inc.activations[i] for i in rows)
    return (
        plant,
        INC(inc.W[np.ix_(rows, rows)] * halves, inc.U[rows], inc.V[:, rows] * halves, inc.K, inc.b[rows], inc.d, units),
        claim,
    )


def idle(plant, inc, claim):
    """The same loop with a unit that always sleeps at z = 0 and is never listened to."""
    q = inc.q
    W = np.zeros((q + 1, q + 1))
    W[:q, :q] = inc.W
    U, V = np.vstack([inc.U, np.zeros((1, inc.p))]), np.hstack([inc.V, np.zeros((inc.m, 1))])
    return plant, INC(W, U, V, inc.K, [*inc.b, 0.0], inc.d, (*inc.activations, inc.activations[0])), claim


def scaled(plant, inc, claim):
    """The same loop with eta_i measured in units of 1 / c_i, which ReLU and leaky ReLU do not notice."""
    c = np.array([1.0, 30.0, 0.2])
    return plant, INC(c[:, None] * inc.W / c, c[:, None] * inc.U, inc.V / c, inc.K, c * inc.b, inc.d, inc.activations), claim


@cache
def bounds_here(kind, bias):
    """The bounds of the rungs that apply to the loop as it is first written, computed once for all its forms."""
    here = same_law(RELUS[kind], bias)
    return {rung: search(*here, rung).require().bound for rung in RUNGS[kind] if not rung.refusal(close_loop(*here[:2]))}


@pytest.mark.parametrize("form", [moved, permuted, split, idle, scaled])
@pytest.mark.parametrize(("kind", "bias"), [("ReLU", False), ("ReLU", True), ("saturation", False), ("curved", False)])
def test_bounds_are_the_same_in_every_form_of_a_loop(kind, bias, form):
    if form is scaled and kind != "ReLU":
        return  # other units do notice
    here = same_law(RELUS[kind], bias)
    there = form(*here)
    x = np.random.default_rng(8).normal(size=(2, 30))
    np.testing.assert_allclose(there[1](x), here[1](x), atol=1e-9)
    for rung, bound in bounds_here(kind, bias).items():
        if form is scaled and rung == Slope():
            continue  # links between units do notice their sizes
        assert search(*there, rung).require().bound == pytest.approx(bound, rel=2e-5), rung


@pytest.mark.slow
@pytest.mark.parametrize("rung", LADDER)
def test_verdicts_are_the_same_in_every_form_of_a_loop(rung):
    # Either side of the largest gain at which the rung proves stability, by a few per cent.
    plant, inc, claim = same_law(RELUS["ReLU"])

    def louder(factor):
        return plant, replace(inc, V=inc.V * factor, activation=inc.activations), claim

    edge, above = 0.25, 256.0
    while above > 1.01 * edge:
        middle = np.sqrt(edge * above)
        holds = search(*louder(middle)[:2], Stability(0.95), rung).holds()
        edge, above = (middle, above) if holds else (edge, middle)
    for form in (moved, permuted, split, idle):
        for factor, expected in ((0.98, True), (1.03, False)):
            at, law, _ = form(*louder(edge * factor))
            assert search(at, law, Stability(0.95), rung).holds() == expected, (form, edge)
