"""The command that checks a file: what it prints, its exit status, and that NumPy alone suffices."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inc_casadi import INC, Box, LeakyReLU, Plant, save
from inc_casadi.__main__ import main, prove, read_certificate
from inc_casadi.certificate import MatrixCertificate, Proof
from inc_casadi.claims import DiscountedCost, Regional
from inc_casadi.errors import FormatError
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
    assert read_certificate(tmp_path / "result.json").bound == PAPER.bound
    assert run({"certificate": WEAK}, tmp_path / "result.json") == 1
    assert run({"plant": PAPER.plant}, tmp_path / "result.json") == 2
    assert "holds no certificate, but dict" in capsys.readouterr().err


def test_what_cannot_be_read_has_a_status_of_its_own(tmp_path, capsys):
    path = tmp_path / "paper.json"
    assert main(["check", str(path)]) == 2
    assert run(PAPER.plant, path) == 2
    PAPER.save(path)
    text = path.read_text()
    path.write_text(text.replace("1.3006", "1.3007"))
    assert main(["check", str(path)]) == 2
    out = capsys.readouterr()
    assert "was altered" in out.err and "holds no certificate, but Plant" in out.err and out.out == ""
    with pytest.raises(FormatError, match="was altered"):
        read_certificate(path)


class Stubborn(RegionalCertificate):
    """Holds in floats, but its rigorous proof does not succeed."""

    def prove(self):
        return Proof(False, "thinking hard", 1.5, "the errors grow too large")


def test_a_certificate_that_is_not_proved_fails_although_it_holds(monkeypatch, capsys):
    stubborn = Stubborn(PIECES.plant, PIECES.inc, SHORT, PIECES.P, PIECES.level)
    monkeypatch.setattr("inc_casadi.__main__.read_certificate", lambda path: stubborn)
    assert stubborn.holds() and main(["check", "any"]) == 1
    assert capsys.readouterr().out.splitlines()[1] == "Not proved by thinking hard in 1.5 s: the errors grow too large."


def test_a_proof_without_holding_is_not_enough(monkeypatch, capsys):
    monkeypatch.setattr("inc_casadi.__main__.read_certificate", lambda path: WEAK)
    monkeypatch.setattr("inc_casadi.__main__.prove", lambda certificate, exactly: Proof(True, "magic", 0.0))
    assert main(["check", "any"]) == 1


def test_exactly_is_asked_of_those_who_know_the_word():
    assert "exact rational arithmetic" in prove(PAPER, exactly=True).method
    assert prove(PAPER, exactly=False) and prove(PIECES, exactly=True) and prove(PIECES, exactly=False)


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


@pytest.mark.parametrize("certificate", [PAPER, PIECES], ids=["matrix", "pieces"])
def test_numpy_alone_suffices(certificate, tmp_path):
    certificate.save(tmp_path / "good.json")
    for options in ([], ["--exact"]):
        done = subprocess.run([sys.executable, "-c", BLOCKED, "check", "good.json", *options], cwd=tmp_path, timeout=120,
                              capture_output=True, text=True, env=environment())
        assert done.returncode == 0, done.stderr
        assert done.stdout == "\n".join([certificate.sentence, done.stdout.splitlines()[1], ""])


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
