"""The command that checks a file: what it prints, its exit status, and that NumPy alone suffices where it can."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inc_casadi import INC, Attraction, Box, Gaussian, LeakyReLU, Plant, Polytope, Spec, bounds, certify, compare, load, save
from inc_casadi.__main__ import main
from inc_casadi.bounds.value_iteration import unlimited
from inc_casadi.certificate import MatrixCertificate, Proof
from inc_casadi.claims import DiscountedCost, Regional
from inc_casadi.dynamic import certify_dynamic, corrected, observer
from inc_casadi.errors import FormatError
from inc_casadi.interchange.checking import prove, settled, verdicts
from inc_casadi.linear import LinearController, linear_cost
from inc_casadi.regional_certificate import RegionalCertificate, certify_region

LAW = INC([[0.3, 0.2], [0.2, 0.3]], [[1.0], [-1.0]], [[-0.7, 0.7]], [[0.0]], activation=LeakyReLU(0.5))
COST = DiscountedCost([[1.0]], [[0.05]], 0.98, Box([-1.0], [1.0]))
PAPER = MatrixCertificate(Plant([[1.2]], [[1.0]]), LAW, COST, "sector", {"P": [[1.3006]], "Lambda": [0.7749, 0.7749]})
WEAK = replace(PAPER, values={"P": [[1.3]], "Lambda": [0.7749, 0.7749]})
UNIT = Box([-1.0], [1.0])
SHORT = Regional(Box([-0.5], [0.5]), UNIT, [[1.0]], [[0.1]], 0.9)
PIECES = certify_region(Plant([[1.2]], [[1.0]]), INC.saturated([[-1.0]], 1.0), SHORT)
HEAVY = ("scipy", "cvxpy", "clarabel", "casadi", "control", "matplotlib", "flint")


def run(certificate, path, *options):
    save(certificate, path)
    return main(["check", str(path), *options])


@pytest.mark.parametrize(("certificate", "words"), [(PAPER, "at most 0.4335"), (PIECES, "converges")])
@pytest.mark.parametrize("options", [(), ("--exact",)])
def test_a_good_certificate_is_printed_and_proved(certificate, words, options, tmp_path, capsys):
    assert run(certificate, tmp_path / "good.json", *options) == 0
    out = capsys.readouterr()
    first, second = out.out.splitlines()
    assert first == certificate.sentence and words in first
    assert second.startswith("Proved by ") and second.endswith(" s.") and out.err == ""
    if options and certificate is PAPER:
        assert "exact rational arithmetic" in second


@pytest.mark.parametrize("options", [(), ("--exact",)])
def test_a_weak_certificate_fails(options, tmp_path, capsys):
    assert run(WEAK, tmp_path / "weak.json", *options) == 1
    assert capsys.readouterr().out.startswith("Not certified: ")


def test_a_result_is_a_mapping_with_a_certificate(tmp_path, capsys):
    assert run({"certificate": PAPER, "seconds": 1.0}, tmp_path / "result.json") == 0
    assert run({"certificate": WEAK}, tmp_path / "result.json") == 1
    assert run({"plant": PAPER.plant}, tmp_path / "result.json") == 2
    assert "holds no certificate, no lower bound and no comparison, but dict" in capsys.readouterr().err


def test_what_cannot_be_read_has_a_status_of_its_own(tmp_path, capsys):
    path = tmp_path / "paper.json"
    assert main(["check", str(path)]) == 2
    assert run(PAPER.plant, path) == 2
    PAPER.save(path)
    text = path.read_text()
    path.write_text(text.replace("1.3006", "1.3007"))
    assert main(["check", str(path)]) == 2
    out = capsys.readouterr()
    assert "was altered" in out.err and "but Plant" in out.err and out.out == ""


class Stubborn(RegionalCertificate):
    """Holds in floats, but its rigorous proof does not succeed."""

    def prove(self):
        return Proof(False, "thinking hard", 1.5, "the errors grow too large")


def test_a_certificate_that_is_not_proved_fails_although_it_holds(monkeypatch, capsys):
    stubborn = Stubborn(PIECES.plant, PIECES.inc, SHORT, PIECES.P, PIECES.level)
    monkeypatch.setattr("inc_casadi.__main__.load", lambda path: stubborn)
    assert stubborn.holds() and main(["check", "any"]) == 1
    assert capsys.readouterr().out.splitlines()[1] == "Not proved by thinking hard in 1.5 s: the errors grow too large."


def test_a_proof_without_holding_is_not_enough(monkeypatch, capsys):
    monkeypatch.setattr("inc_casadi.__main__.load", lambda path: WEAK)
    monkeypatch.setattr("inc_casadi.interchange.checking.prove", lambda certificate, exactly: Proof(True, "magic", 0.0))
    assert main(["check", "any"]) == 1


def test_exactly_is_asked_of_those_who_know_the_word():
    assert "exact rational arithmetic" in prove(PAPER, exactly=True).method
    assert prove(PAPER, exactly=False) and prove(PIECES, exactly=True) and prove(PIECES, exactly=False)


SCALAR, CLIPPED = Plant(1.5, 1.0), INC.saturated([[-1.5]], 1.0)
SPEC = Spec(1.0, 0.1, 0.9, UNIT, UNIT)
COMPARISON = compare(SCALAR, SPEC, {"clipped": CLIPPED, "late": LinearController.static([[-0.9]]), "wild": lambda y: -3 * y})
MEASURED = Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])
MEMORY = observer(MEASURED, [[2.0], [1.0]], corrected(INC.saturated([[-0.5, -1.2]], 0.5), [[1.0], [1.0]], MEASURED.C))
NARROW = Regional(Box([-1.0, -0.5], [1.0, 0.5]), Box([-0.5], [0.5]), np.eye(2), [[0.1]], 0.95)
THINGS = {
    "matrix": PAPER,
    "pieces": PIECES,
    "ellipsoid": certify(SCALAR, CLIPPED, Attraction(UNIT)),
    "linear cost": linear_cost(SCALAR, SPEC, LinearController([[0.1]], [[0.2]], [[0.0]], [[-0.9]])),
    "dynamic": certify_dynamic(MEASURED, MEMORY, NARROW),
    "affine moves": bounds.affine_moves(SCALAR, SPEC, 2),
    "any controller": bounds.any_controller(SCALAR, SPEC, cells=30),
    "unlimited": unlimited(SCALAR, Spec(1.0, 0.1, 0.9, UNIT)),
    "static gains": bounds.static_output_feedback(SCALAR, SPEC, gap=0.1),
    "comparison": COMPARISON,
}


@pytest.mark.parametrize("name", [name for name in THINGS if name != "comparison"])
def test_each_kind_is_printed_and_proved(name, tmp_path, capsys):
    assert run(THINGS[name], tmp_path / "good.json") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == str(THINGS[name]) and lines[1].startswith("Proved by ")


@pytest.mark.parametrize("name", ["affine moves", "any controller", "unlimited", "static gains"])
def test_a_bound_that_says_too_much_is_not_confirmed(name, tmp_path, capsys):
    bound = THINGS[name]
    assert run(replace(bound, value=1.2 * bound.value), tmp_path / "bad.json") == 1
    out = capsys.readouterr().out
    assert out.startswith("Not confirmed: its numbers do not prove ") and "Proved" not in out


def test_a_bound_that_holds_in_floats_only_is_said_to_and_fails(tmp_path, capsys):
    bound = bounds.any_controller(SCALAR, Spec(1.0, 0.1, 0.9, Gaussian([0.0], [[1.0]]), UNIT), cells=30)
    assert bound.holds() and run(bound, tmp_path / "floats.json") == 1
    assert "Not proved by exact rational arithmetic" in capsys.readouterr().out


def test_a_comparison_is_printed_with_what_its_proofs_gave(tmp_path, capsys):
    assert not COMPARISON.proofs and run(COMPARISON, tmp_path / "comparison.json") == 0
    out = capsys.readouterr().out
    first, table = out.split("\n\n", 1)
    assert first.count("Proved by ") == 5 and "clipped: From every starting point" in first
    assert table.strip() == str(settled(COMPARISON, verdicts(COMPARISON)))
    assert "exact, proved" in table and "both are proved" in table and "holds in floating point" not in table


def test_a_comparison_with_a_weak_bound_fails(tmp_path, capsys):
    floors = (replace(COMPARISON.floors[0], bound=replace(COMPARISON.floors[0].bound, value=9.0)), *COMPARISON.floors[1:])
    assert run(replace(COMPARISON, floors=floors), tmp_path / "weak.json") == 1
    out = capsys.readouterr().out
    assert "lower bound, any controller: Not confirmed" in out and "INCONSISTENT" in out


def test_a_contradiction_fails_though_everything_is_proved(tmp_path, monkeypatch):
    """It would be an error of the toolbox, for true statements do not contradict each other."""
    monkeypatch.setattr(type(COMPARISON), "inversions", lambda self: ("two figures that cannot both be true",))
    assert run(COMPARISON, tmp_path / "comparison.json") == 1


def test_proofs_that_a_file_records_are_not_believed(tmp_path, capsys):
    weak = replace(COMPARISON.rows[1].cost.evidence, W=np.zeros((1, 1)))
    rows = (COMPARISON.rows[0], replace(COMPARISON.rows[1], cost=replace(COMPARISON.rows[1].cost, evidence=weak)))
    claimed = replace(COMPARISON, rows=rows, proofs={row.name: Proof(True, "magic", 0.0) for row in rows})
    assert run(claimed, tmp_path / "claimed.json") == 1
    assert "magic" not in capsys.readouterr().out


def test_a_result_without_a_certificate_fails_whatever_its_bounds_are(tmp_path, capsys):
    parts = {"certificate": None, "bounds": {"linear controllers": THINGS["affine moves"]}}
    assert run(parts, tmp_path / "result.json") == 1
    out = capsys.readouterr().out
    assert "the result has no certificate" in out and "lower bound, linear controllers: Every linear" in out
    assert run(parts | {"certificate": PAPER}, tmp_path / "result.json") == 0
    weak = replace(THINGS["affine moves"], value=9.0)
    assert run({"certificate": PAPER, "bounds": {"linear controllers": weak}}, tmp_path / "result.json") == 1


@pytest.mark.parametrize("spoil", [
    lambda bound: replace(bound, cells=replace(bound.cells, record=replace(bound.cells.record, cut=np.array([10**6])))),
    lambda bound: replace(bound, trials=(replace(bound.trials[0], u=np.zeros((3, 2))),)),
    lambda bound: replace(bound, steps=0), lambda bound: replace(bound, trials=(PAPER,)),
])
def test_numbers_that_do_not_fit_together_prove_nothing(spoil, tmp_path, capsys):
    assert run(spoil(THINGS["any controller"]), tmp_path / "odd.json") != 0
    assert "Proved" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("field", "value"), [("steps", 2.5), ("steps", "many"), ("trials", "none"), ("seconds", True), ("cells", PAPER)]
)
def test_values_of_another_type_are_refused_at_the_door(field, value, tmp_path):
    save(replace(THINGS["any controller"], **{field: value}), tmp_path / "odd.json")
    with pytest.raises(FormatError, match=f"AnyControllerBound refuses its data: {field} is"):
        load(tmp_path / "odd.json")


BLOCKED = f"""
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {HEAVY!r}:
            raise ImportError(f"{{name}} is out of reach")
sys.meta_path.insert(0, Blocked())
from inc_casadi.__main__ import main
status = main(sys.argv[1:])
loaded = set({HEAVY!r}) & set(sys.modules)
assert not loaded, loaded
sys.exit(status)
"""


@pytest.mark.parametrize("name", THINGS)
def test_numpy_alone_suffices(name, tmp_path):
    save(THINGS[name], tmp_path / "good.json")
    for options in ([], ["--exact"])[: 2 if name in ("matrix", "pieces") else 1]:
        done = subprocess.run([sys.executable, "-c", BLOCKED, "check", "good.json", *options], cwd=tmp_path, timeout=120,
                              capture_output=True, text=True, env=environment())
        assert done.returncode == 0, done.stderr
        assert "Proved by" in done.stdout and "Not " not in done.stdout.partition("\n\n")[0]


def test_what_needs_more_than_numpy_says_so(tmp_path):
    triangle = Polytope([[-1.0, 0.0], [0.0, -1.0], [1.0, 1.0]], [0.5, 0.5, 0.5])
    save(bounds.any_controller(MEASURED, Spec(np.eye(2), 0.1, 0.9, triangle, UNIT), cells=20), tmp_path / "polytope.json")
    done = subprocess.run([sys.executable, "-c", BLOCKED, "check", "polytope.json"], cwd=tmp_path, timeout=120,
                          capture_output=True, text=True, env=environment())
    assert done.returncode == 2 and "cannot be checked without further packages: scipy" in done.stderr


def test_as_a_command(tmp_path):
    good, bad = tmp_path / "good.json", tmp_path / "bad.json"
    PAPER.save(good)
    content = json.loads(good.read_text())
    content["data"]["values"]["map"]["P"]["array"] = [1.0]
    bad.write_text(json.dumps(content))
    for path, status in ((good, 0), (bad, 2), (tmp_path / "absent.json", 2)):
        done = subprocess.run([sys.executable, "-m", "inc_casadi", "check", str(path)], cwd=tmp_path, timeout=120,
                              capture_output=True, text=True, env=environment())
        assert done.returncode == status
        assert ("Proved by" in done.stdout) == (status == 0) and bool(done.stderr) == (status == 2)


def environment():
    """The place that this copy of the package is imported from, wherever the command runs."""
    import inc_casadi
    return {"PYTHONPATH": str(Path(inc_casadi.__file__).parents[1]), "PATH": ""}


def test_many_units_take_a_moment_only(tmp_path, capsys):
    rng = np.random.default_rng(81)
    W, A = rng.normal(size=(64, 64)), rng.normal(size=(10, 10))
    W, A = 0.3 * W / np.abs(W).sum(axis=1).max(), 0.7 * A / np.linalg.norm(A, 2)
    law = INC(W, 0.1 * rng.normal(size=(64, 10)), 0.01 * rng.normal(size=(3, 64)), 0.01 * rng.normal(size=(3, 10)))
    claim = DiscountedCost(0.01 * np.eye(10), 0.01 * np.eye(3), 0.9, Box(-np.ones(10), np.ones(10)))
    values = {"P": np.eye(10), "Lambda": np.full(64, 0.1)}
    certificate = MatrixCertificate(Plant(A, 0.3 * rng.normal(size=(10, 3))), law, claim, "sector", values)
    assert run(certificate, tmp_path / "large.json") == 0
    assert certificate.prove().seconds < 0.5
