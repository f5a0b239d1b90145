"""Where figures were measured: the digest of the source follows the source, and nothing is needed that may be missing."""

from __future__ import annotations

import subprocess

import pytest

from benchmarks.contest import environment as room
from benchmarks.contest.environment import environment


@pytest.fixture
def tree(tmp_path, monkeypatch):
    for folder in ("inc_casadi", "benchmarks/plants"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "a.py").write_text("x = 1\n")
    monkeypatch.setattr(room, "ROOT", tmp_path)
    return tmp_path


def test_the_source_is_told_apart_by_names_and_contents(tree):
    first = environment().source
    (tree / "inc_casadi" / "a.py").write_text("x = 2\n")
    second = environment().source
    (tree / "inc_casadi" / "a.py").rename(tree / "inc_casadi" / "b.py")
    assert len({first, second, environment().source}) == 3


def test_what_does_not_measure_does_not_count(tree):
    first = environment().source
    (tree / "benchmarks" / "plants" / "a.py").write_text("x = 2\n")
    (tree / "inc_casadi" / "notes.txt").write_text("no module")
    assert environment().source == first


def test_without_git_there_is_no_commit(tree, monkeypatch):
    assert environment().commit == ""  # no repository there
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: (_ for _ in ()).throw(FileNotFoundError("git")))
    assert environment().commit == ""


def test_a_system_that_does_not_tell_its_memory(monkeypatch):
    monkeypatch.setattr(room.os, "sysconf_names", {}, raising=False)
    assert environment().memory is None


def test_a_package_that_is_missing_is_said(monkeypatch):
    monkeypatch.setattr(room, "PACKAGES", {"ghost": "no-such-distribution-anywhere"})
    assert environment().versions["ghost"] == "not installed"
