"""How much work a comparison may take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..pieces.walk import Budget

Say = Callable[[str], None]


@dataclass(frozen=True)
class Effort:
    """How far each part of a comparison may go.

    Parameters
    ----------
    budget : of the exact pieces of one controller
    cells : about how many, for the bound on any controller
    moves : how many are counted for the bound on linear controllers; None: as many as raise it
    seconds : for the bound on static linear gains
    samples : simulated starting points of a controller without certificate
    seed : of all random numbers
    """

    budget: Budget = Budget()
    cells: int = 3_000
    moves: int | None = None
    seconds: float = 30.0
    samples: int = 20_000
    seed: int = 0
