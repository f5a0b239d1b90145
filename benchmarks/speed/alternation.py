"""How far the BMI loop lowers certified costs, and in what time: six plants, seven laws, three ways to propose."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inc_casadi import INC, DiscountedCost, Gaussian, LeakyReLU, Plant, ReLU, Spec, Tanh
from inc_casadi.activations import Activation
from inc_casadi.arrays import Array
from inc_casadi.linear.static_gain import best_static_gain
from synthesis.alternation import Alternation, alternate
from synthesis.certified_cost import certified_cost
from synthesis.law_family import Frozen, flat, unflat
from synthesis.starts.random_start import input_range, measurement_range

from ..plants.suite import suite

WAYS = ("joint", "gradient", "fixed")
STEPS, POINTS = 400, 2000
DIFFERENCE = 1e-5


@dataclass(frozen=True, eq=False)
class Case:
    """A plant, a law to begin with, and what is claimed; frozen: what stays."""

    name: str
    plant: Plant
    inc: INC
    claim: DiscountedCost
    frozen: Frozen = ()


@dataclass(frozen=True)
class Row:
    """One case: certified bound before and after, the true cost of the final law by simulation, the least bound possible.

    floor: the cost of the best static linear gain found, below which nothing quadratic is certified; rises: by how much the
    bound has risen in any round, relative; error: of the gradient against differences of the inequality solved anew, also
    relative.
    """

    name: str
    way: str
    before: float
    after: float
    simulated: float
    floor: float
    rises: float
    proved: bool
    rounds: int
    seconds: float
    error: float


def cases() -> list[Case]:
    """Return the cases; all plants are stable, all laws implicit, and "refused" has no certificate to begin with.

    >>> [case.inc.q for case in cases()]
    [4, 6, 6, 8, 6, 6, 6]
    """
    return [_case("2 states, ReLU", 2, 1, 1, 4, ReLU(), 0.05, 0), _case("3 states, tanh", 3, 2, 2, 6, Tanh(), 0.05, 1),
            _case("3 states, leaky", 3, 1, 1, 6, LeakyReLU(0.3), 0.05, 2),
            replace(_case("4 states, ReLU, K = 0 kept", 4, 1, 2, 8, ReLU(), 0.05, 1), frozen=("K",)),
            _case("4 states, ReLU, refused", 4, 2, 2, 6, ReLU(), 0.5, 3),
            _of_suite("AC17", 6, Tanh(), 0.02, 0), _of_suite("four tanks, output", 6, ReLU(), 0.02, 0)]


def _of_suite(name: str, q: int, unit: Activation, size: float, seed: int) -> Case:
    """Return a plant of the suite under a random law of the size of its measurements and inputs, input limits left out."""
    (plant, spec, _), rng = suite()[name], np.random.default_rng(seed)
    W = rng.normal(size=(q, q))
    U = rng.normal(size=(q, plant.p)) / measurement_range(plant, spec)
    V = size * input_range(spec)[:, None] * rng.normal(size=(plant.m, q))
    inc = INC(0.5 * W / np.abs(W).sum(axis=1).max(), U, V, np.zeros((plant.m, plant.p)), activation=unit)
    return Case(f"{name}, {unit}", plant, inc, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))


def _case(name: str, n: int, m: int, p: int, q: int, unit: Activation, size: float, seed: int) -> Case:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    plant = Plant(0.9 * A / np.max(np.abs(np.linalg.eigvals(A))), rng.normal(size=(n, m)), rng.normal(size=(p, n)))
    W = rng.normal(size=(q, q))
    inc = INC(0.5 * W / np.abs(W).sum(axis=1).max(), rng.normal(size=(q, p)), size * rng.normal(size=(m, q)),
              np.zeros((m, p)), activation=unit)
    spread = rng.normal(size=(n, n))
    initial = Gaussian(np.zeros(n), np.eye(n) + 0.3 * spread @ spread.T)
    return Case(name, plant, inc, DiscountedCost(np.eye(n), 0.1 * np.eye(m), 0.95, initial))


def alternation(ways: Sequence[str] = WAYS, multiplier: str = "slope", chosen: list[Case] | None = None,
                max_rounds: int = 20) -> list[Row]:
    """Return one row for each case and way to propose."""
    return [_measured(case, way, multiplier, max_rounds) for case in (cases() if chosen is None else chosen) for way in ways]


def _measured(case: Case, way: str, multiplier: str, max_rounds: int) -> Row:
    began = time.perf_counter()
    found = alternate(case.plant, case.inc, case.claim, way=way, multiplier=multiplier, frozen=case.frozen,
                      max_rounds=max_rounds)
    seconds = time.perf_counter() - began
    claim = case.claim
    floor = best_static_gain(case.plant, Spec(claim.Q, claim.R, claim.discount, claim.initial)).cost
    after = found.certificate.bound if found.certificate.holds() else np.inf
    return Row(case.name, way, found.start_bound, after, simulated(case, found.inc), floor, rises(found),
               bool(found.certificate.prove()), len(found.history), seconds, gradient_error(case, found, multiplier))


def simulated(case: Case, inc: INC, seed: int = 0) -> float:
    """Return the mean discounted cost over points of the initial distribution, their second moment made exact."""
    x = case.claim.initial.sample(POINTS, np.random.default_rng(seed))
    x = np.hstack([x, -x])
    root = np.linalg.cholesky(case.claim.initial.second_moment) @ np.linalg.inv(np.linalg.cholesky(x @ x.T / x.shape[1]))
    x, total = root @ x, 0.0
    for k in range(STEPS):
        u = inc(case.plant.C @ x)
        stage = np.einsum("in,ij,jn->n", x, case.claim.Q, x) + np.einsum("in,ij,jn->n", u, case.claim.R, u)
        total += case.claim.discount**k * float(stage.mean())
        x = case.plant.A @ x + case.plant.B @ u
    return total


def rises(found: Alternation) -> float:
    """Return the largest relative rise of the bound from one round of a rung to the next; 0 when it never rises."""
    bounds = [row["bound"] for row in found.history if row["phase"] == "cost"]
    return max([(after - before) / before for before, after in zip(bounds, bounds[1:], strict=False)] + [0.0])


def gradient_error(case: Case, found: Alternation, multiplier: str, seed: int = 0) -> float:
    """Return the relative error of the gradient along a random direction, at the start, or near the end if it has none.

    NaN where no certificate was found at all.
    """
    if not found.certificate.holds():
        return np.nan
    start, end = flat(case.inc), flat(found.inc)
    direction = np.random.default_rng(seed).normal(size=start.size)
    theta = start if np.isfinite(found.start_bound) else end + 0.02 * (start - end)

    def at(point: Array) -> INC:
        W, U, V, K = unflat(point, case.inc)
        return INC(W, U, V, K, activation=case.inc.activation)

    slope = certified_cost(case.plant, at(theta), case.claim, multiplier).slope @ direction
    ahead, behind = (certified_cost(case.plant, at(theta + sign * DIFFERENCE * direction), case.claim, multiplier).value
                     for sign in (1.0, -1.0))
    return float(abs((ahead - behind) / (2 * DIFFERENCE) - slope) / abs(slope))


def alternation_table(rows: list[Row]) -> str:
    """Return the rows as text; the ratio is that of the bound to the least of the ways, in the same run."""
    lines = [f"{'case':<27} {'way':<9} {'before':>9} {'after':>9} {'change':>7} {'ratio':>6} {'simulated':>9} {'floor':>9} "
             f"{'rises':>6} {'proved':>6} {'rounds':>6} {'s/round':>7} {'gradient':>9}"]
    for row in rows:
        change = f"{100 * (row.after / row.before - 1):.1f}%" if np.isfinite(row.before) else _found(row)
        least = min(other.after for other in rows if other.name == row.name)
        ratio = f"{row.after / least:.4g}" if np.isfinite(row.after) else "-"
        lines.append(f"{row.name:<27} {row.way:<9} {row.before:>9.4f} {row.after:>9.4f} {change:>7} {ratio:>6} "
                     f"{row.simulated:>9.4f} {row.floor:>9.4f} {row.rises:>6.0e} {'yes' if row.proved else 'no':>6} "
                     f"{row.rounds:>6} {row.seconds / max(row.rounds, 1):>7.2f} {row.error:>9.1e}")
    return "\n".join(lines)


def _found(row: Row) -> str:
    return "new" if np.isfinite(row.after) else "none"
