"""Bounds within the time: each takes its share, what it has by then holds, and a note says that more time may raise it."""

import time

import numpy as np
import pytest

from benchmarks.plants.oscillators import masses
from inc_casadi import Box, Gaussian, Plant, Spec
from synthesis import lower_bounds as module
from synthesis import synthesize
from synthesis.lower_bounds import ANY, LINEAR, competitors, floor, lower_bounds
from synthesis.progress import Progress

TWO = Plant([[1.1, 1.0], [0.0, 1.02]], [[0.2], [0.5]])
SPEC = Spec(np.eye(2), 0.05, 0.98, Box([-0.8, -0.8], [0.8, 0.8]), Box(-1, 1))


def test_without_a_budget_nothing_is_cut_short():
    notes = []
    found = lower_bounds(TWO, SPEC, notes, Progress(False))
    assert notes == [] and float(found[LINEAR]) == pytest.approx(2.1167631, abs=1e-6) and floor(found) > 1.3648


def test_with_no_time_at_all_the_bounds_hold_and_are_said_to_be_cut_short():
    notes = []
    found = lower_bounds(TWO, SPEC, notes, Progress(False, seconds=0.0))
    assert all(bound.holds() and bound.cut_short for bound in found.values()) and 0 < floor(found) < 1.365
    assert sum("its share of the time; it holds" in note for note in notes) == len(found) == 3


@pytest.mark.slow
def test_twelve_states_take_their_share_of_the_time_and_no_more():
    """Six masses: 4096 vertices, where all horizons up to 128 take minutes."""
    case, notes = masses(6), []
    progress = Progress(False, seconds=8.0)
    found = lower_bounds(case.plant, case.spec, notes, progress)
    gains = competitors(case.plant, case.spec, 0, notes, progress)
    assert progress.elapsed < 12.0 and len(found) == 3 and found[ANY].holds() and len(gains) >= 1


def test_the_reason_for_a_missing_bound_is_noted():
    notes = []
    found = lower_bounds(TWO, Spec(SPEC.Q, SPEC.R, 0.9, Gaussian([0, 0], np.eye(2)), SPEC.inputs), notes, Progress(False))
    assert set(found) == {ANY} and sum("no lower bound for linear controllers" in note for note in notes) == 2


def test_seconds_are_shared_out_between_bounds_and_search(monkeypatch):
    asked = {}

    def watched(name):
        def bound(plant, spec, **options):
            asked[name] = options["seconds"]
            return getattr(original, name)(plant, spec, **options)
        return bound

    from inc_casadi import bounds as original
    names = ("first_move", "affine_moves", "any_output_feedback")
    fake = type("bounds", (), {name: staticmethod(watched(name)) for name in names})
    monkeypatch.setattr(module, "bounds", fake)
    began = time.monotonic()
    synthesize(Plant([[1.5]], [[1.0]]), Spec([[1.0]], [[0.0]], 0.9, Box(-1, 1), Box(-1, 1)), hidden=0, seconds=40.0,
               verbose=False)
    assert asked == {"first_move": 2.0, "affine_moves": 6.0, "any_output_feedback": 6.0} and time.monotonic() - began < 10.0
