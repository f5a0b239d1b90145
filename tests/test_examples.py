"""Every example runs as a user runs it, and computes what it says it does."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "examples"
SCRIPTS = sorted(FOLDER.glob("[0-9]*.py"))
RELATIVE = 1e-3  # expected figures are printed to four digits or so
LONG = ("04_training_pays", "06_regions_and_reachable_sets", "08_pictures", "09_continuous_time",
        "10_with_memory")  # 3 to 17 s of processor


def test_there_are_examples():
    assert [script.name[:2] for script in SCRIPTS] == [f"{i + 1:02d}" for i in range(len(SCRIPTS))] and SCRIPTS
    assert set(LONG) < {script.stem for script in SCRIPTS}


@pytest.mark.parametrize("script", [pytest.param(script, id=script.stem, marks=[pytest.mark.slow] * (script.stem in LONG))
                                    for script in SCRIPTS])
def test_example_computes_what_it_expects(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)  # pictures go to the current folder
    spec = importlib.util.spec_from_file_location(f"example_{script.stem}", script)
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    computed, expected = example.main()
    assert computed.keys() == expected.keys()
    for name, figure in expected.items():
        assert computed[name] == pytest.approx(figure, rel=RELATIVE), name
    assert all(picture.stat().st_size > 10_000 for picture in tmp_path.glob("*.png"))


