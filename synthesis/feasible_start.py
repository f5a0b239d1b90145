"""Phase one of the BMI loop: a law without a certificate is moved until one exists, with the future fading less and less."""

from __future__ import annotations

import numpy as np

from inc_casadi.claims.base import Claim
from inc_casadi.multipliers import Multiplier
from inc_casadi.plant import Plant

from .bmi_search import Search
from .certified_cost import CertifiedCost, cost_at
from .condition_graph import ConditionGraph, condition_graph

INSIDE = 0.9  # of the largest certified fading at which the cost is lowered: at the largest itself P is infinite
HALVINGS = 7
ROUNDS, CYCLES = 2, 20  # accepted rounds per fading, and fadings at most
GROWTH = 1e-3


def make_feasible(search: Search, plant: Plant, claim: Claim, rung: Multiplier) -> None:
    """Move the law of a search until the claim is certified about it, or no more progress is made.

    A claim about the plant with sqrt(tau) A, sqrt(tau) B weighs step k by tau^k beside its discount: the inequality asks
    for X'PX - tau beta F'PF and so on, and a law that passes for tau passes for less. At tau = 0 only the law's own
    well-posedness counts, so some tau passes. Lowering the certified cost there shrinks what the loop amplifies, so that a
    larger tau passes; tau = 1 is the claim. (The violation nu itself is a poor guide: its least value is near that of
    P = 0, where it has no slope.)
    """
    law = search.family.start
    tau, point = 0.0, _at(plant, claim, rung, search, 0.0)[1]
    if point is None:
        search.status = "nothing is certified about the law, not even that it is well posed"
        return
    for _ in range(CYCLES):
        tau, done = _largest(plant, claim, rung, search, tau)
        if done or search.is_over:
            return
        graph, point = _at(plant, claim, rung, search, INSIDE * tau)
        if point is None:
            return
        search.descend(graph, point, "feasibility", ROUNDS)
        if search.family.start is law:
            return
        law = search.family.start


def _at(plant: Plant, claim: Claim, rung: Multiplier, search: Search,
        tau: float) -> tuple[ConditionGraph, CertifiedCost | None]:
    """Return the inequalities for a fading, and the certified cost of the present law there."""
    faded = Plant(np.sqrt(tau) * plant.A, np.sqrt(tau) * plant.B, plant.C, plant.dt)
    graph = condition_graph(faded, search.family.start, claim, rung)
    return graph, cost_at(graph, search.family.start)


def _largest(plant: Plant, claim: Claim, rung: Multiplier, search: Search, low: float) -> tuple[float, bool]:
    """Return the largest fading that is certified about the present law, from one that is, and whether it is 1."""
    if _at(plant, claim, rung, search, 1.0)[1] is not None:
        return 1.0, True
    high = 1.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _at(plant, claim, rung, search, middle)[1] is not None else (low, middle)
    return low, False
