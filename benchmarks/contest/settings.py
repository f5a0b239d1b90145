"""How much work a run of the suite puts into each plant."""

from __future__ import annotations

from dataclasses import dataclass

from inc_casadi.arrays import number
from inc_casadi.sets.rules import whole

SYNTHESIZED, MEMORY = "synthesized INC", "synthesized INC with memory"
QUICK_PLANTS = ("scalar", "two states", "two lags, output", "double integrator", "pendulum, output")


@dataclass(frozen=True)
class Settings:
    """The budgets of one plant, all in seconds of wall time but the counts.

    Parameters
    ----------
    seed : of every random choice
    hidden : units that `synthesize` trains
    search : what `synthesize` and `synthesize_dynamic` may each take for their search; training: for one training or proof
        in it; proof: for the rigorous proof of what they return
    pieces : for the exact pieces of one competitor
    linear, gains : for the lower bounds on linear controllers and on static gains
    region : for each certificate of how far the initial set may grow, 0 for none
    cells : for the lower bound on any controller
    samples : simulated starting points where nothing is certified
    limit : of processor time, after which nothing more is begun on a plant
    only : the controllers that are wanted, by name; all when empty

    Raises
    ------
    InvalidInputError : a count or budget that is none

    >>> Settings(only=("saturated LQR",)).wants("LQG"), Settings().wants("LQG")
    (False, True)
    """

    seed: int = 0
    hidden: int = 8
    search: float = 20.0
    training: float = 10.0
    proof: float = 20.0
    pieces: float = 8.0
    linear: float = 10.0
    gains: float = 5.0
    region: float = 2.0
    cells: int = 3_000
    samples: int = 4_000
    limit: float = 150.0
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("hidden", 0), ("cells", 1), ("samples", 2)):
            whole(name, getattr(self, name), least)
        for name in ("search", "training", "proof", "pieces", "linear", "gains", "limit"):
            number(name, getattr(self, name), 0.0, open_low=True)
        number("region", self.region, 0.0)

    def wants(self, name: str) -> bool:
        """Return whether the controller of that name is to be looked at."""
        return not self.only or name in self.only


QUICK = Settings(hidden=4, search=6.0, training=2.0, proof=5.0, pieces=2.0, linear=2.0, gains=1.0, region=0.5, cells=1_000,
                 samples=5_000, limit=50.0)
