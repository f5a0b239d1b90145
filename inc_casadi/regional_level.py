"""How small a terminal set around an equilibrium on kinks to take: measured, since nothing foretells what a walk costs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .pieces.enclosure import ERROR_ROOM

if TYPE_CHECKING:
    from .regional_certificate import RegionalCertificate

SHARP = 1e-9  # by what share of the worst cost a conewise tail may overestimate before a smaller level is tried
FIRST_ERROR = 1e-52  # of a vertex in a walk with 256 places, about
MOST_VERTICES = 100_000  # that a proof follows within minutes
FACTORS = (1e-2, 0.2)  # by how much at once, first boldly
SPARED = 0.05  # the share of the budget that a walk may use for another to be tried


def sharpened(certificate: RegionalCertificate) -> RegionalCertificate:
    """Lower the level of a conewise certificate until its tail is sharp, as long as the walks it takes are cheap.

    Motions are followed further then, and less of their cost is bounded rather than summed. Each level is walked: how many
    pieces that takes depends on how the cones turn into each other. The last one counts that came to an end and that a proof
    can be expected to follow.

    >>> from inc_casadi import INC, Box, Plant, Regional, certify
    >>> claim = Regional(Box([-1.0], [1.0]), None, [[1.0]], [[0.0]])
    >>> sharp = certify(Plant([[0.5]], [[1.0]]), INC([[0.0]], [[1.0]], [[-0.5]], [[0.0]]), claim)
    >>> round(sharp.worst[0], 6), sharp.gap < 2e-9
    (1.333333, True)
    """
    for factor in FACTORS:
        certificate = _lowered(certificate, factor)
    return certificate


def _lowered(certificate: RegionalCertificate, factor: float) -> RegionalCertificate:
    budget = certificate.budget
    while certificate.reason == "" and certificate.gap > SHARP * certificate.worst[0]:
        walk = certificate.walk
        assert walk is not None
        if len(walk.arrived) > SPARED * budget.pieces or walk.seconds > SPARED * budget.seconds:
            break
        wanted = 0.3 * SHARP * certificate.worst[0] / certificate.gap  # the gap falls about as the level does
        smaller = replace(certificate, level=max(wanted, factor) * certificate.level)
        if smaller.reason or not _looks_provable(smaller):
            break
        certificate = smaller
    return certificate


def _looks_provable(certificate: RegionalCertificate) -> bool:
    """Whether a proof is likely to follow the walk: not too many vertices, and errors that stay small against the level.

    A guess, not a verdict: an error of 1e-52 that grows by |A| + |B| L |C| in each step, L the law's Lipschitz bounds, and
    the room that `enclosure.Enclosure.arrives` leaves for it.
    """
    walk, plant = certificate.walk, certificate.plant
    if walk is None or certificate.P is None or len(walk.arrived.owner) > MOST_VERTICES:
        return False
    growth = np.abs(plant.A) + np.abs(plant.B) @ certificate.inc.well_posedness().lipschitz @ np.abs(plant.C)
    error = np.full(plant.n, FIRST_ERROR)
    for _ in range(int(walk.steps_taken.max(initial=0))):
        error = growth @ error + FIRST_ERROR
    return bool(error @ np.abs(certificate.P) @ error < ERROR_ROOM * certificate.level)
