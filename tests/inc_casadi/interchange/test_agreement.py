"""What a comparison in a file says must agree with its evidence: forged rows, bounds and classes are refused at the door."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inc_casadi import (
    INC,
    Box,
    Gaussian,
    Plant,
    Polytope,
    Regional,
    Spec,
    Stability,
    Tanh,
    bounds,
    certify,
    compare,
    load,
    save,
)
from inc_casadi.comparison.families import ANY, LINEAR, STATIC
from inc_casadi.comparison.row import CERTIFIED, Finding
from inc_casadi.errors import FormatError
from inc_casadi.interchange.agreement import disagreement, limits_kept, same, strange_bound, strange_certificate
from inc_casadi.interchange.checking import verdicts
from inc_casadi.interchange.encoding import digest, encoded
from inc_casadi.linear import LinearController

PLANT, UNIT = Plant(1.5, 1.0), Box(-1.0, 1.0)
SPEC = Spec(1.0, 0.1, 0.9, UNIT, UNIT)
LAWS = {"clipped": INC.saturated([[-1.5]], 1.0), "linear": LinearController.static([[-0.9]]), "inc": INC.linear([[-0.95]]),
        "poor": [[-3.0]]}
FOUND = compare(PLANT, SPEC, LAWS)
GENTLE, BOUNDED = Plant(0.5, 1.0), INC([[0.0]], [[0.1]], [[-0.5]], [[0.0]], activation=Tanh())
CURVED = compare(
    GENTLE, Spec(1.0, 0.1, 0.9, Gaussian([0.0], [[1.0]]), UNIT), {"tanh": BOUNDED, "open": INC.linear([[-0.1]])}, bounds=[]
)


def refused(comparison, words, folder):
    save(comparison, folder / "forged.json")
    with pytest.raises(FormatError, match=words):
        load(folder / "forged.json")


def with_row(i, comparison=FOUND, **changes):
    rows = list(comparison.rows)
    rows[i] = replace(rows[i], **changes)
    return replace(comparison, rows=tuple(rows))


@pytest.mark.parametrize("comparison", [FOUND, CURVED], ids=["pieces", "inequality"])
def test_what_compare_made_agrees(comparison, tmp_path):
    assert disagreement(comparison) == "" and any(row.certified for row in comparison.rows)
    save(comparison, tmp_path / "honest.json")
    assert str(load(tmp_path / "honest.json")) == str(comparison)


@pytest.mark.parametrize("i", [0, 1, 2])
def test_a_cost_below_what_its_certificate_proves(i, tmp_path):
    cost = FOUND.rows[i].cost
    assert FOUND.rows[i].certified
    refused(with_row(i, cost=replace(cost, value=0.99 * cost.value)), "its cost is stated as", tmp_path)
    refused(with_row(i, cost=replace(cost, value=np.nan)), "its cost is stated as", tmp_path)


def test_a_certificate_of_another_plant_controller_or_specification(tmp_path):
    words = "another plant or controller"
    refused(with_row(0, controller=INC.saturated([[-1.4]], 1.0)), words, tmp_path)
    refused(with_row(1, controller=LinearController.static([[-0.8]])), words, tmp_path)
    refused(with_row(2, controller=INC.linear([[-0.9]])), words, tmp_path)
    refused(with_row(2, controller=INC(np.zeros((0, 0)), [], [], [[-0.95]], d=[0.1])), words, tmp_path)
    refused(with_row(1, cost=FOUND.rows[0].cost), words, tmp_path)
    refused(replace(FOUND, plant=Plant(1.4, 1.0)), words, tmp_path)
    for spec in (replace(SPEC, inputs=Box(-0.5, 0.5)), replace(SPEC, Q=[[2.0]]), replace(SPEC, discount=0.91),
                 replace(SPEC, initial=Box(-1.1, 1.1))):
        refused(replace(FOUND, spec=spec), "another specification", tmp_path)


def test_limits_that_rest_on_nothing(tmp_path):
    """A matrix inequality says nothing of limits, and a linear law from a Gaussian state exceeds them."""
    row = CURVED.row("tanh")
    assert row.certified and disagreement(CURVED) == ""
    stable = replace(CURVED, spec=replace(CURVED.spec, inputs=Box(-0.4, 0.4)))
    refused(stable, "rests on nothing", tmp_path)
    unlimited = compare(GENTLE, Spec(1.0, 0.1, 0.9, Gaussian([0.0], [[1.0]])), {"open": INC.linear([[-0.1]])}, bounds=[])
    assert unlimited.rows[0].certified
    assert limits_kept((), INC.linear([[-0.1]]), unlimited.spec) and not limits_kept((), INC.linear([[-0.1]]), CURVED.spec)
    assert not limits_kept((unlimited.rows[0],), LinearController.static([[1.0]]), SPEC)
    assert limits_kept((certify(PLANT, LAWS["clipped"], Regional(UNIT, UNIT, [[1.0]], [[0.1]], 0.9)),), None, SPEC)


def test_a_certificate_that_is_about_something_else(tmp_path):
    found = certify(GENTLE, BOUNDED, Stability(0.9))
    row = CURVED.row("tanh")
    forged = with_row(
        0, CURVED, cost=replace(row.cost, evidence=found, value=found.bound), limits=Finding(CERTIFIED, "so I say")
    )
    refused(forged, "another specification", tmp_path)


def test_bounds_of_another_problem_or_a_smaller_class(tmp_path):
    linear = bounds.affine_moves(PLANT, SPEC, 2)
    other = replace(FOUND.floors[1], bound=bounds.affine_moves(Plant(1.4, 1.0), SPEC, 2))
    refused(replace(FOUND, floors=(other,)), "about another plant or specification", tmp_path)
    for family in (ANY, LINEAR):
        smaller = replace(FOUND.floors[2], family=family)
        refused(replace(FOUND, floors=(smaller,)), "one on a smaller class", tmp_path)
    refused(replace(FOUND, floors=(replace(FOUND.floors[1], family=ANY),)), "one on a smaller class", tmp_path)
    assert strange_bound(linear, PLANT, SPEC, STATIC) == "" and strange_bound(linear, PLANT, SPEC, LINEAR) == ""
    assert strange_bound(FOUND.floors[0].bound, PLANT, SPEC, STATIC) == ""


def test_a_class_in_other_words(tmp_path):
    renamed = replace(FOUND.floors[1].family, every="every controller on earth")
    refused(replace(FOUND, floors=(replace(FOUND.floors[1], family=renamed),)), "described in other words", tmp_path)


def test_evidence_that_does_not_hold_is_read_but_certifies_nothing(tmp_path):
    cost = FOUND.rows[1].cost
    weak = with_row(1, cost=replace(cost, evidence=replace(cost.evidence, W=0.0 * cost.evidence.W)))
    save(weak, tmp_path / "weak.json")
    back = load(tmp_path / "weak.json")
    assert not back.certifies("linear") and back.certifies("clipped")
    assert [one.holds for one in verdicts(back) if one.name == "linear"] == [False]


def test_same_is_to_the_bit_but_for_vertices_known_or_not():
    square = Polytope([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], [1.0, 1.0, 1.0, 1.0])
    seen = Polytope(square.H, square.h)
    assert seen.volume > 0 and digest(encoded(seen)) != digest(encoded(square)) and same(seen, square)
    assert same(Regional(seen, None, np.eye(2), [[1.0]]), Regional(square, None, np.eye(2), [[1.0]]))
    assert not same(square, Polytope(square.H, square.h * (1 + 1e-15)))
    assert not same(Spec(1.0, 0.1, 0.9, UNIT), Spec(1.0, 0.1, np.nextafter(0.9, 1), UNIT))


def test_a_strange_certificate_is_told_apart():
    claim = Regional(UNIT, UNIT, [[1.0]], [[0.1]], 0.9)
    found = certify(PLANT, LAWS["clipped"], claim)
    assert strange_certificate(found, PLANT, SPEC, LAWS["clipped"]) == ""
    assert "plant" in strange_certificate(found, GENTLE, SPEC, LAWS["clipped"])
    assert "specification" in strange_certificate(found, PLANT, replace(SPEC, inputs=None), LAWS["clipped"])


OLD = Path(__file__).with_name("version_2.json")


def test_files_of_this_version_that_were_written_before_open_and_prove():
    """Written when the toolbox knew fewer kinds."""
    found = load(OLD)
    assert len(found) == 21 and found["mixed"].activations[0].slope == 1 / 3 and found["ellipsoid"].level == 0.7
    judged = list(verdicts(found))
    assert len(judged) == 12 and all(one.passed for one in judged)
