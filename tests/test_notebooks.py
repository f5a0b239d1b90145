"""Every teaching notebook runs from clean, without a warning, and gives the figures that are stored in it.

Needs nbclient, nbformat and ipykernel. What a cell prints is compared word by word, its numbers up to `RELATIVE` (other
machines round differently); cells tagged "timing" may print what they like. Running them is no part of the default run:
`pytest -m notebooks`; that what is stored is complete, without a complaint and names no place is.
"""

from __future__ import annotations

import copy
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("ipykernel", reason="notebooks run in a kernel: pip install nbclient nbformat ipykernel")
nbclient = pytest.importorskip("nbclient", reason="notebooks are run by nbclient: pip install nbclient nbformat ipykernel")
nbformat = pytest.importorskip("nbformat", reason="notebooks are read by nbformat: pip install nbclient nbformat ipykernel")

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
RELATIVE, ABSOLUTE = 1e-3, 1e-9
LARGEST_FILE = 400_000  # bytes
LONGEST = 60.0  # seconds of processor time in the kernel
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!\w)")
EACH_NOTEBOOK = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def outputs_of(cell: Any) -> list[Any]:
    """Return the outputs of a cell; a text cell has none."""
    return cell.get("outputs", [])


def printed(cell: Any) -> str:
    """Return all that a cell wrote or displayed as text, in order."""
    return "".join(output.text if output.output_type == "stream" else output.get("data", {}).get("text/plain", "")
                   for output in outputs_of(cell))


def pictures(cell: Any) -> int:
    """Return how many pictures a cell shows."""
    return sum("image/png" in output.get("data", {}) for output in outputs_of(cell))


def complaints(notebook: Any) -> list[str]:
    """Return what went to stderr, and errors."""
    outputs = [output for cell in notebook.cells for output in outputs_of(cell)]
    warned = [output.text for output in outputs if output.output_type == "stream" and output.name == "stderr"]
    return warned + [output.evalue for output in outputs if output.output_type == "error"]


def same_text(stored: str, again: str) -> bool:
    """Say whether two texts have the same words and, up to rounding, the same numbers."""
    if NUMBER.sub("#", stored).split() != NUMBER.sub("#", again).split():
        return False
    then, now = ([float(figure) for figure in NUMBER.findall(text)] for text in (stored, again))
    return then == pytest.approx(now, rel=RELATIVE, abs=ABSOLUTE)


def executed(notebook: Any, folder: Path) -> Any:
    """Return a copy of a notebook without outputs, run in a fresh kernel whose folder is empty."""
    clean = copy.deepcopy(notebook)
    for cell in clean.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    client = nbclient.NotebookClient(clean, timeout=600, kernel_name="python3", coalesce_streams=True, record_timing=False,
                                     resources={"metadata": {"path": str(folder)}})
    return client.execute()


@EACH_NOTEBOOK
def test_a_notebook_says_what_it_teaches_and_ends_with_exercises(path: Path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert "After this notebook you can" in notebook.cells[0].source
    lessons = [cell for cell in notebook.cells if "solution" not in cell.metadata.get("tags", [])]
    assert any("Exercises" in cell.source for cell in lessons[-4:] if cell.cell_type == "markdown")
    assert sum(pictures(cell) for cell in notebook.cells) > 0
    assert complaints(notebook) == [] and path.stat().st_size < LARGEST_FILE
    text = "".join(printed(cell) for cell in notebook.cells)
    places = (str(FOLDER.parents[1]), sys.prefix, tempfile.gettempdir(), "site-packages")
    assert [place for place in places if place in text] == []


@EACH_NOTEBOOK
def test_each_exercise_has_a_solution_at_the_end_whose_code_is_folded_in(path: Path):
    notebook = nbformat.read(path, as_version=4)
    solution = ["solution" in cell.metadata.get("tags", []) for cell in notebook.cells]
    first = solution.index(True)
    assert all(solution[first:]) and notebook.cells[first].source.startswith("## Solutions")
    [exercises] = [cell.source for cell in notebook.cells[:first] if "## Exercises" in cell.source]
    asked = re.findall(r"^(\d+)\. \*\*", exercises, re.MULTILINE)
    given = [cell.source.partition(".**")[0].removeprefix("**") for cell in notebook.cells[first + 1:]
             if cell.cell_type == "markdown"]
    assert given == asked and len(asked) >= 4
    for cell in notebook.cells[first:]:
        if cell.cell_type == "code":
            assert cell.metadata.jupyter.source_hidden and "hide-cell" in cell.metadata.tags and printed(cell)


@pytest.mark.notebooks
@EACH_NOTEBOOK
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the kernel's client, which is not ours
def test_a_notebook_runs_from_clean_and_gives_its_stored_figures(path: Path, tmp_path: Path,
                                                                  monkeypatch: pytest.MonkeyPatch):
    for variable in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR"):  # nobody's own settings
        monkeypatch.setenv(variable, str(tmp_path / variable.lower()))
    monkeypatch.delenv("MPLBACKEND", raising=False)
    (tmp_path / "work").mkdir()
    stored, before = nbformat.read(path, as_version=4), os.times()
    again = executed(stored, tmp_path / "work")
    after = os.times()
    seconds = after.children_user + after.children_system - before.children_user - before.children_system
    print(f"{path.stem}: {seconds:.1f} s of processor time, {after.elapsed - before.elapsed:.1f} s in all")
    assert complaints(again) == []
    for number, (then, now) in enumerate(zip(stored.cells, again.cells, strict=True), start=1):
        assert pictures(then) == pictures(now), f"cell {number} shows another number of pictures:\n{now.source}"
        if "timing" not in then.metadata.get("tags", []):
            assert same_text(printed(then), printed(now)), f"cell {number} stores {printed(then)}\nand gives {printed(now)}"
    assert seconds < LONGEST


def test_texts_are_the_same_up_to_the_rounding_of_their_numbers():
    assert same_text("cost 1.36496, proved", "cost 1.36500, proved")
    assert not same_text("cost 1.365, proved", "cost 1.375, proved")
    assert not same_text("cost 1.365, proved", "cost 1.365, not proved")
    assert not same_text("rungs: 1 2", "rungs: 1 2 3")
