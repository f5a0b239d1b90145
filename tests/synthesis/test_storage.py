"""A result reopens with everything that it printed, and every proof in it can be settled again."""

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from inc_casadi import INC, Box, DiscountedCost, Plant, ReLU, Spec, bounds, certify, load, save
from inc_casadi.__main__ import main
from inc_casadi.errors import FormatError
from inc_casadi.interchange.encoding import encoded
from synthesis import Result, load_result, synthesize
from synthesis.causes import Cause
from synthesis.gate import Verdict
from synthesis.result import Attempt

PLANT, UNIT = Plant(1.5, 1.0), Box(-1.0, 1.0)
SPEC = Spec(1.0, 0.1, 0.9, UNIT, UNIT)
OLD = Path(__file__).with_name("result_version_2.json")


@pytest.fixture(scope="module")
def certified():
    return synthesize(PLANT, SPEC, hidden=0, verbose=False)


@pytest.fixture(scope="module")
def failed(certified):
    """The same search, had the gate refused its only attempt and its motions diverged."""
    refused = Verdict(None, np.inf, ("well posed",), ("exact pieces: too many",), (Cause.PIECES,))
    tried = replace(certified.history[0], verdict=refused)
    return replace(certified, certificate=None, proof=None, history=(tried,), chosen=tried, notes=("nothing passed",),
                   estimate=replace(certified.estimate, mean=np.inf, standard_error=np.inf, largest=np.inf, settled=False))


def reopened(result, folder):
    result.save(folder / "result.json")
    return load_result(folder / "result.json")


@pytest.mark.parametrize("outcome", ["certified", "failed"])
def test_it_prints_the_same(outcome, request, tmp_path):
    result = request.getfixturevalue(outcome)
    saved = reopened(result, tmp_path)
    assert str(saved) == str(saved.result) == str(result)
    assert saved.result.status == result.status and str(saved.result.comparison()) == str(result.comparison())


def test_every_part_survives(certified, failed, tmp_path):
    for result in (certified, failed):
        back = reopened(result, tmp_path).result
        for name in ("plant", "spec", "inc", "certificate", "proof", "estimate"):
            assert encoded(getattr(back, name)) == encoded(getattr(result, name))
        assert (back.notes, back.ended) == (result.notes, result.ended)
        for name in ("bounds", "linear", "seconds"):
            assert encoded(dict(getattr(back, name))) == encoded(dict(getattr(result, name)))
        assert len(back.history) == len(result.history) > 0
        assert back.chosen in back.history and back.chosen.name == result.chosen.name


def test_attempts_survive_with_their_verdicts_and_causes(failed, tmp_path):
    tried = failed.history[0]
    marked = replace(
        tried,
        training=((0.5, 3.0), (1.0, 2.0)),
        inner=INC.linear([[1.0]]),
        of="a",
        why="b",
        before=2.5,
        timed=True,
        verdict=Verdict(None, np.inf, ("well posed",), ("too many pieces",), (Cause.PIECES, Cause.TIME)),
    )
    back = reopened(replace(failed, history=(tried, marked), chosen=marked), tmp_path).result
    assert back.chosen is back.history[1]
    again = back.history[1]
    assert again.verdict.causes == (Cause.PIECES, Cause.TIME) and again.verdict.cost == np.inf
    assert (again.training, again.of, again.why, again.before, again.timed) == (marked.training, "a", "b", 2.5, True)
    assert again.inner.K.tolist() == [[1.0]] and np.isnan(back.history[0].before)


def test_its_proofs_are_settled_again(certified, tmp_path, capsys):
    saved = reopened(certified, tmp_path)
    assert saved.holds() and saved.certificate.prove()
    assert len(saved.bounds) >= 3 and all(bound.holds() and bound.prove() for bound in saved.bounds.values())
    assert main(["check", str(tmp_path / "result.json")]) == 0
    assert capsys.readouterr().out.count("Proved by ") == 1 + len(saved.bounds)


def test_a_failed_result_is_kept_and_fails_the_check(failed, tmp_path, capsys):
    saved = reopened(failed, tmp_path)
    assert not saved.holds() and saved.result.status == "failed"
    assert main(["check", str(tmp_path / "result.json")]) == 1
    assert "the result has no certificate" in capsys.readouterr().out


def test_a_result_without_candidates(certified, tmp_path):
    empty = Result(PLANT, SPEC, None, None, None, None, {}, {}, (), ("interrupted",), {})
    saved = reopened(empty, tmp_path)
    assert saved.inc is None and saved.result.chosen is None and saved.result.notes == ("interrupted",)


def test_a_result_that_was_written_before_there_was_so_much_opens():
    saved = load_result(OLD)
    assert saved.holds() and saved.result.status == "certified" and saved.certificate.prove()
    assert saved.figures["lower bound, any controller"] == pytest.approx(0.416992)
    assert saved.result.history == () and "CERTIFIED" in str(saved)
    assert main(["check", str(OLD)]) == 0


def forged(certified, folder, **changes):
    certified.save(folder / "forged.json")
    parts = dict(load(folder / "forged.json")) | changes
    save(parts, folder / "forged.json")
    return folder / "forged.json"


def test_strangers_are_refused(certified, tmp_path):
    other = bounds.affine_moves(Plant(1.4, 1.0), SPEC, 2)
    for changes, words in (({"plant": Plant(1.4, 1.0)}, "another plant or controller"),
                           ({"inc": INC.saturated([[-1.0]], 1.0)}, "another plant or controller"),
                           ({"inc": None}, "another plant or controller"),
                           ({"spec": replace(SPEC, discount=0.8)}, "another specification"),
                           ({"bounds": {"any controller": other}}, "another plant or specification"),
                           ({"bounds": {"any controller": bounds.affine_moves(PLANT, SPEC, 2)}}, "one on a smaller class")):
        with pytest.raises(FormatError, match=words):
            load_result(forged(certified, tmp_path, **changes))


def test_limits_must_rest_on_something(tmp_path):
    """A certificate by matrix inequality says nothing of limits: the law's range must."""
    law = INC([[0.0]], [[0.1]], [[-0.5]], [[0.0]], activation=ReLU())
    spec = Spec(1.0, 0.1, 0.9, UNIT)
    found = certify(Plant(0.5, 1.0), law, DiscountedCost(spec.Q, spec.R, spec.discount, spec.initial))
    parts = {"plant": Plant(0.5, 1.0), "spec": spec, "inc": law, "certificate": found, "figures": {}}
    save(parts, tmp_path / "open.json")
    assert load_result(tmp_path / "open.json").holds()
    save(parts | {"spec": replace(spec, inputs=UNIT)}, tmp_path / "open.json")
    with pytest.raises(FormatError, match="rests on nothing"):
        load_result(tmp_path / "open.json")


@pytest.mark.parametrize(
    "changes", [{"history": ({"name": "x"},)}, {"chosen": 7}, {"surprise": 1}, {"bounds": 3}, {"history": 3}]
)
def test_odd_parts_are_refused(certified, changes, tmp_path):
    with pytest.raises(FormatError, match="holds no result of synthesize"):
        load_result(forged(certified, tmp_path, **changes))


def test_other_files_are_no_results(tmp_path):
    save(PLANT, tmp_path / "plant.json")
    save({"plant": PLANT}, tmp_path / "mapping.json")
    for name in ("plant.json", "mapping.json"):
        with pytest.raises(FormatError, match="holds no result"):
            load_result(tmp_path / name)
    content = json.loads(OLD.read_text())
    (tmp_path / "old.json").write_text(json.dumps(content | {"version": 3}))
    with pytest.raises(FormatError, match="version 3"):
        load_result(tmp_path / "old.json")


def test_no_field_of_a_result_is_forgotten(certified, tmp_path):
    certified.save(tmp_path / "result.json")
    parts = load(tmp_path / "result.json")
    assert set(parts) == {field.name for field in fields(Result)} | {"figures"}
    assert set(parts["history"][0]) == {field.name for field in fields(Attempt)}
