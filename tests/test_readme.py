"""The README's code runs as it stands, and its figures are those that come out."""

import re
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)


def test_the_readme_code_runs_and_gives_the_figures_it_states(tmp_path, monkeypatch, capsys):
    text, blocks = TEXT, BLOCKS
    assert len(blocks) == 6 and len(blocks[0].strip().splitlines()) <= 14
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(blocks[0], "README.md", "exec"), names)
    result = names["result"]
    assert result.status == "certified" and "1.36496190" in text
    assert result.certificate.expected == pytest.approx(1.36496190, abs=1e-8)
    assert "than 1.36496." in text and 1.3649604 <= float(result.bounds["any controller"]) <= 1.3649619
    assert "0.00011 %" in text and "within 0.00011 %" in str(result)
    linear = float(result.bounds["linear controllers"])
    assert linear == pytest.approx(2.116763, abs=1e-6) and "2.116763" in text
    assert abs(names["u"][0]) <= 1 and names["result"].certificate.prove()
    assert "CERTIFIED" in capsys.readouterr().out

    from inc_casadi.__main__ import main
    assert main(["check", "result.json"]) == 0
    assert "converges" in capsys.readouterr().out


def test_the_second_block_proves_what_is_printed(capsys):
    text, block = TEXT, BLOCKS[1]
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert printed.count("succeeded=True") == 4
    cost = next(line for line in printed.splitlines() if "discounted cost" in line)
    bounds = [float(figure) for figure in re.findall(r"bound ([0-9.]+)", cost)]
    assert bounds == pytest.approx([124.7, 53.1, 12.94, 12.28], rel=1e-3)
    assert "124.7 (sector) to 53.1 (slope), 12.94 (relu)\nand 12.28 (lifted)" in text


def test_the_third_block_certifies_and_refutes_what_it_says(capsys):
    text, block = TEXT, BLOCKS[2]
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    assert printed.count("succeeded=True") == 2 and "the next state lies in the region again" in printed
    found = names["found"]
    assert 2.338 <= found.factor < found.refuted <= 2.342 and "2.338 (a motion that fails is shown at 2.342)" in text
    assert "12.06" in text and "\n12.05" in printed


def test_the_fourth_block_says_the_sentence(tmp_path, monkeypatch, capsys):
    text, block = TEXT, BLOCKS[3]
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    sentence = ("Every admissible finite-order dynamic linear controller costs at least 2.116763; clipped LQR costs at most "
                "1.364962; both are proved.")
    assert sentence in capsys.readouterr().out and sentence in " ".join(text.split())
    found = names["found"]
    assert found.cost_of("best linear found") < 2.116764 and found.cost_of("best gain found") < 3.347185
    assert 3.3137 < found.floor("static").value and "at least 3.3137" in text and "3.347184" in text
    assert found.inversions() == () and (tmp_path / "comparison.png").exists()


def test_the_fifth_block_synthesizes_a_controller_with_memory(capsys):
    text, block = TEXT, BLOCKS[4]
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    result = names["result"]
    assert result.proof and result.cost <= 1.202 and "cost of at most 1.20134" in text
    assert "at least 2.099943" in capsys.readouterr().out and "costs at least 2.099943" in text
    assert 1.2011 < result.bounds["any controller"].value < 1.20113 and "less than 1.201121" in " ".join(text.split())
    steady = min(one.cost for one in result.history if one.name.startswith("observer with noise"))
    assert 1.5255 < steady < 1.5265 and "costs 1.526," in text


def test_the_sixth_block_certifies_a_network_and_writes_it_as_c(tmp_path, monkeypatch):
    text, block = TEXT, BLOCKS[5]
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    found, source = names["found"], names["source"]
    assert found.prove() and found.bound == pytest.approx(0.8954694, rel=1e-6) and "0.8954694" in text
    assert source.operations == 45 and "takes 45 operations" in text
    assert source.absolute < 1.67e-15 and source.relative < 1.86e-14 and (tmp_path / "generated" / "law.c").exists()
