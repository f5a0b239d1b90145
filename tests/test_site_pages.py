"""The guide pages of the site: their code runs as it stands, and the figures they state are those of the code."""

import re
from pathlib import Path

import pytest

from inc_casadi.judgement import Cause
from synthesis.registry import STARTS

SITE = Path(__file__).parents[1] / "examples" / "site"


def run(page):
    """Execute the one example of a page, and return its names."""
    blocks = re.findall(r"```python\n(.*?)```", (SITE / page).read_text(encoding="utf-8"), flags=re.DOTALL)
    assert len(blocks) == 1
    names = {"__name__": page}
    exec(compile(blocks[0], page, "exec"), names)
    return names


def test_the_page_on_certified(capsys):
    names = run("guide/certified.md")
    assert names["certificate"].bound == pytest.approx(1 / 0.36 / 3, rel=1e-5)  # P = 1 / (1 - 0.8^2), E x0^2 = 1/3
    assert names["lower"].bound < 0.91 / 0.36 / 3 and not names["lower"].holds()
    assert "succeeded=True" in capsys.readouterr().out


@pytest.mark.slow
def test_every_cause_is_explained_and_its_example_is_refused_for_it():
    names, text = run("guide/refusals.md"), (SITE / "guide/refusals.md").read_text(encoding="utf-8")
    assert set(re.findall(r'starts=\["(.+?)"\]', text)) <= set(STARTS)
    for cause in Cause:
        assert f"| `{cause.name}` | {cause.value} |" in text
        verdict = names["refused"][cause.name]
        assert not verdict.accepted and cause in verdict.causes and verdict.refusals
    assert names["accepted"].accepted and names["accepted"].causes


@pytest.mark.slow
def test_the_page_on_output_feedback():
    """The figures it states, in the order in which they must lie."""
    names = run("guide/output_feedback.md")
    assert names["result"].status == "certified" and names["result"].cost == pytest.approx(1.22746, abs=1e-5)
    assert float(names["floor"]) == pytest.approx(1.2004, abs=1e-4) and names["floor"].holds()
    assert float(names["linear"]) == pytest.approx(2.09994, abs=1e-5)


def test_the_page_on_deployment(capsys):
    source = run("guide/deployment.md")["source"]
    assert source.error_bound < 1e-11 and "int law(const double y[1], double u[1])" in source.header
    assert "law.h law.c" in capsys.readouterr().out


def test_the_page_on_files(capsys):
    names = run("guide/files.md")
    assert names["status"] == 0 and "was altered" in capsys.readouterr().out


def test_the_limits_state_the_constants_of_the_code():
    from inc_casadi.activations.bell import VALUE_ROUNDING
    from inc_casadi.certify import MOST_UNKNOWNS
    from inc_casadi.pieces.cell_walk import MOST_DIMENSIONS
    from synthesis.registry import MOST_EXPLICIT_STATES, MOST_MPC_UNITS

    text = " ".join((SITE / "guide/limits.md").read_text(encoding="utf-8").split())
    assert f"more than {MOST_DIMENSIONS} dimensions" in text and f"more than {MOST_UNKNOWNS} unknowns" in text
    assert f"at most {MOST_MPC_UNITS} units, and explicit ones with at most {MOST_EXPLICIT_STATES} states" in text
    assert f"roundings: {VALUE_ROUNDING:.0f} in local slopes and sectors" in text


def test_the_parts_of_the_readme_that_pages_include_are_there():
    readme = (SITE.parents[1] / "README.md").read_text(encoding="utf-8")
    for page in ("quickstart.md", "guide/limits.md"):
        marks = re.findall(r':(?:start-after|end-before): "(.*)"', (SITE / page).read_text(encoding="utf-8"))
        assert len(marks) == 2 and all(readme.count(f"\n{mark}\n") == 1 for mark in marks)
        assert readme.index(marks[0]) < readme.index(marks[1])


def test_the_extras_are_those_of_the_project():
    import tomllib

    project = tomllib.loads((SITE.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    listed = re.findall(r"^\| `(\w+)` \|", (SITE / "install.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert set(listed) == set(project["optional-dependencies"])
