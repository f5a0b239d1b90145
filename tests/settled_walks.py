"""Walks over polytopes that are ready to be settled with 256 places."""

from dataclasses import replace

import numpy as np

from inc_casadi import INC, Box, Plant
from inc_casadi.claims.regional import Regional
from inc_casadi.pieces.cell_walk import cell_walk
from inc_casadi.pieces.laws import PiecewiseLoop
from inc_casadi.pieces.terminal import find, in_fractions

SHARE = 1 - 2.0**-40  # of the terminal level, as `regional_proof` lowers it


def walked(plant, inc, claim):
    loop = PiecewiseLoop(plant, inc)
    terminal, why = find(loop, claim)
    assert terminal is not None, why
    exactly = in_fractions(replace(loop, arithmetic="exact"), claim, terminal)
    return cell_walk(loop, claim, terminal), replace(loop, arithmetic="fixed"), exactly


def clipped(gain=((-1.37, -2.65),), limit=1.0, half=0.8):
    plant = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
    box = Box([-half, -half], [half, 0.9 * half])
    return plant, INC.saturated(gain, limit), Regional(box, Box([-limit], [limit]), np.eye(2), [[0.05]], 0.98)
