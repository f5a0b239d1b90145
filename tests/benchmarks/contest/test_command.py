"""The command line: the suite by default, results in a folder, names checked at the door."""

from __future__ import annotations

import json
import logging
from argparse import Namespace

import pytest

from benchmarks import commands, options
from benchmarks.__main__ import main
from benchmarks.contest import command
from benchmarks.contest.files import read_records, write_record
from benchmarks.contest.runner import Run
from benchmarks.contest.sample import record
from benchmarks.contest.settings import QUICK, QUICK_PLANTS, Settings
from benchmarks.contest.sheets import write_sheet
from benchmarks.paper.row import Row
from benchmarks.plants import suite
from benchmarks.speed import Measurement

FILES = {"RESULTS.md", "costs.png", "times.png", "wins.png", "results.json", "results.csv"}


@pytest.fixture
def asked(monkeypatch) -> Namespace:
    """What the runner is asked for; it answers with one record."""
    seen = Namespace(records=(record(1.0, {"LQG": 2.0}, plant="car"),), interrupted=False)

    def run(cases, settings, folder, executor, width, *, fresh, say):
        seen.__dict__.update(cases=list(cases), settings=settings, folder=folder, width=width, fresh=fresh)
        return Run(seen.records, ("car",), seen.interrupted, 1.0)

    monkeypatch.setattr(command, "run", run)
    return seen


def test_the_suite_is_the_default(asked, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([]) == 0
    assert asked.cases == list(suite()) and asked.settings == Settings() and not asked.fresh
    assert asked.folder == options.FOLDER and {path.name for path in (tmp_path / options.FOLDER).iterdir()} == FILES
    said = capsys.readouterr().out
    assert "certified on 1 of 1 plant" in said and "1 plant in 1 s, 1 known from a former run" in said


def test_every_option_arrives(asked, tmp_path):
    arguments = ["--plant", "car", "pendulum", "--only", "synthesized", "LQG", "--quick", "--jobs", "3", "--seed", "7"]
    assert main([*arguments, "--fresh", "--out", str(tmp_path)]) == 0
    assert asked.cases == ["pendulum", "car"] and asked.width == 3 and asked.fresh and asked.folder == tmp_path
    assert (asked.settings.seed, asked.settings.only, asked.settings.hidden) == (7, ("synthesized INC", "LQG"), QUICK.hidden)
    assert command.controllers(["memory"]) == ("synthesized INC with memory",)


def test_quick_takes_a_few_plants(asked, tmp_path):
    main(["suite", "--quick", "--out", str(tmp_path)])
    assert set(asked.cases) == set(QUICK_PLANTS) <= set(suite())


@pytest.mark.parametrize(("change", "status"), [
    ({"error": "lost"}, 1), ({"inversions": ("a cost below a bound",)}, 1), ({}, 0)])
def test_the_status_tells_of_failures_and_contradictions(asked, tmp_path, change, status: int):
    asked.records = (record(1.0, {}, plant="car", **change),)
    assert main(["suite", "--out", str(tmp_path)]) == status


def test_an_interrupted_run_writes_what_it_has(asked, tmp_path):
    asked.interrupted = True
    assert main(["suite", "--out", str(tmp_path)]) == 130
    assert (tmp_path / "RESULTS.md").exists()


@pytest.mark.parametrize(("arguments", "words"), [
    (["--plant", "boat"], "no plant of the suite is named 'boat'"), (["--only", "PID"], "no controller is named 'PID'"),
    (["--jobs", "0"], "at least one plant"), (["page", "--records", "nowhere"], "holds no records"),
    (["--jobs", "2", "--dask", "here:1"], "not allowed with"), (["--fresh", "--resume"], "not allowed with")])
def test_what_cannot_be_done_is_refused_at_the_door(arguments: list[str], words: str, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as refused:
        main(arguments)
    assert refused.value.code == 2 and words in capsys.readouterr().err


def test_the_page_is_written_from_records_and_sheets(tmp_path, capsys):
    write_record(tmp_path / "out", record(1.0, {"LQG": 2.0}, plant="car"))
    write_sheet(tmp_path / "out", "paper", "P  1.3006")
    page = tmp_path / "RESULTS.md"
    assert main(["page", "--records", str(tmp_path / "out"), "--out", str(page)]) == 0
    text = page.read_text()
    assert "certified on 1 of 1 plant" in text and "P  1.3006" in text and "](out/costs.png)" in text
    assert "1 plant:" in capsys.readouterr().out


def test_tables_of_the_other_commands_are_kept(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(commands.paper, "all_rows", lambda: [Row("P", "1.3006", 1.3006, "sec")])
    monkeypatch.setattr(commands.speed, "main_job", lambda: [Measurement("job", 2.0, "s", 1.0)])
    assert main(["paper", "--out", str(tmp_path)]) == 0 and main(["main", "--out", str(tmp_path)]) == 1
    assert json.loads((tmp_path / "sheets" / "paper.json").read_text())["rows"][0]["computed"] == 1.3006
    printed = capsys.readouterr().out
    for title in ("paper", "main"):
        assert json.loads((tmp_path / "sheets" / f"{title}.json").read_text())["text"] in printed


def test_all_parts_of_speed_are_measured_and_kept(tmp_path, monkeypatch, capsys):
    for name in ("imports", "exact_cost", "evaluation"):
        monkeypatch.setattr(commands.speed, name, list)
    monkeypatch.setattr(commands.speed, "main_job", lambda: [Measurement("job", 2.0, "s", 1.0)])
    for name in ("certification", "pieces", "training", "alternation", "single_evaluation"):
        monkeypatch.setattr(commands.speed, name, list)
    assert main(["speed", "--out", str(tmp_path)]) == 1  # the main job misses its target, whatever comes after it
    assert {path.stem for path in (tmp_path / "sheets").iterdir()} == {
        f"speed-{part}" for part in ("times", "certify", "certify-targets", "pieces", "training", "alternation", "single")}
    said = capsys.readouterr().out
    assert all(f"speed {part}\n" in said for part in commands.PARTS) and "all parts: 0 s of the processor" in said
    assert main(["speed", "times"]) == 1 and "all parts" not in capsys.readouterr().out


def test_two_plants_from_end_to_end(tmp_path, capsys):
    arguments = ["suite", "--plant", "scalar", "two states", "--only", "synthesized", "saturated LQR", "best linear gain",
                 "--quick", "--jobs", "2", "--out", str(tmp_path)]
    assert main(arguments) == 0
    first = read_records(tmp_path, tuple(suite()))
    assert [(one.plant, one.error) for one in first] == [("scalar", ""), ("two states", "")]
    assert all(one.entries[0].certified for one in first)
    assert FILES < {path.name for path in tmp_path.iterdir()}
    capsys.readouterr()


def test_a_dask_cluster_computes_it(tmp_path, capsys):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None,
                                  silence_logs=logging.CRITICAL) as cluster:
        assert main(["--plant", "scalar", "--only", "saturated LQR", "--quick", "--dask", cluster.scheduler_address,
                     "--out", str(tmp_path)]) == 0
    [record_] = read_records(tmp_path)
    assert record_.entries[0].certified
    capsys.readouterr()


def test_a_dask_scheduler_that_does_not_answer_is_an_error(capsys, monkeypatch, tmp_path):
    pytest.importorskip("distributed")
    monkeypatch.setattr(command, "CONNECTING", 0.1)
    with pytest.raises(SystemExit):
        main(["--plant", "scalar", "--dask", "tcp://127.0.0.1:9", "--out", str(tmp_path)])
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err


@pytest.mark.slow
def test_the_quick_suite_is_certified_throughout(tmp_path, capsys):
    assert main(["--quick", "--out", str(tmp_path)]) == 0
    records = read_records(tmp_path)
    assert len(records) == len(QUICK_PLANTS) and all(one.entries[0].certified for one in records)
    capsys.readouterr()
