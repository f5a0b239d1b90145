"""What a result says of itself is said by the code of comparisons, and only what it has."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.plants.paper import scalar
from inc_casadi.certificate import Proof
from synthesis import Result, synthesize
from synthesis.report import verdict_sentence


@pytest.fixture(scope="module")
def found() -> Result:
    case = scalar(0.9)
    return synthesize(case.plant, case.spec, hidden=0, verbose=False)


def test_the_sentence_names_the_largest_class_once_and_the_distance(found: Result):
    text = verdict_sentence(found)
    assert text.startswith("Proved: every admissible finite-order dynamic linear controller costs at least 0.40")
    assert "; this controller costs at most 0.3583334; no controller whatever costs less than 0.358" in text
    assert text.count("costs at least") == 1 and text in str(found)


def test_without_a_rigorous_proof_the_sentence_says_so(found: Result):
    for proof in (None, Proof(False, "exact", 0.0, "no")):
        assert verdict_sentence(replace(found, proof=proof)).startswith("In floating point: every admissible")


def test_without_certificate_or_bounds_nothing_is_said(found: Result):
    assert verdict_sentence(replace(found, certificate=None)) == "" == verdict_sentence(replace(found, bounds={}))


def test_the_comparison_has_the_controller_and_its_bounds(found: Result):
    shown = found.comparison()
    assert shown.separates("this controller", "linear") and shown.require_consistent() is shown
    assert [floor.family.key for floor in shown.floors] == ["linear", "linear", "any"]
    assert shown.cost_of("this controller") == found.cost and shown.proofs["this controller"] is found.proof
    assert replace(found, inc=None, certificate=None).comparison().rows == ()
    assert not replace(found, certificate=None).comparison().certifies("this controller")
