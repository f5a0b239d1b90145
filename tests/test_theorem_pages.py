"""Every published statement has a page, with functions and tests that exist; read without Sphinx."""

import importlib
import importlib.util
import pkgutil
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SITE = ROOT / "examples" / "site"
LABELS = {
    "ass:cone", "ass:incremental_sector", "ass:sector", "cor:genuine_of", "prop:certification_gate",
    "prop:implicit_gradients", "prop:no_arbitrary_sof", "prop:projected_training_wp", "prop:pwa_relu", "thm:ct_stability",
    "thm:dt_stability", "thm:general_superiority", "thm:incremental_certificate", "thm:input_penalty_sep", "thm:longrun_dyn",
    "thm:lsof_sep", "thm:performance", "thm:wellposed"}


UNLISTED = {"bounds", "errors", "plants"}  # packages, each with a page of its own
UNLISTED |= {f"{part}_table" for part in ("alternation", "certification", "pieces", "single", "training")}
UNLISTED |= {"ABOUT", "AT_LEAST", "AT_MOST", "FOUND"}  # words, explained under the pictures
UNLISTED |= {"certification_targets", "table"}  # how the benchmarks print what they measured


def registry():
    """Return the site's registry module, which is in no package."""
    if "site_registry" not in sys.modules:
        spec = importlib.util.spec_from_file_location("site_registry", SITE / "site_registry.py")
        module = importlib.util.module_from_spec(spec)
        sys.modules["site_registry"] = module  # its dataclass looks itself up
        spec.loader.exec_module(module)
    return sys.modules["site_registry"]


THEOREMS = {theorem.label: theorem for theorem in registry().theorems()}


def test_every_statement_of_the_paper_is_registered_once():
    assert set(THEOREMS) == LABELS and len(registry().theorems()) == len(LABELS)


@pytest.mark.parametrize("label", sorted(LABELS))
def test_a_page_says_what_carries_and_checks_it(label):
    theorem = THEOREMS[label]
    assert registry().problems(theorem) == []
    page = (SITE / f"{theorem.page}.md").read_text(encoding="utf-8")
    assert page.startswith(f"({label})=\n# {theorem.title}\n") and f"```{{theorem-links}} {label}\n" in page
    assert "**Why it is true" in page and "$" in page and "## Beyond the paper" in page


def test_what_is_wrong_with_an_entry_is_found():
    good, problems = THEOREMS["thm:wellposed"], registry().problems
    assert problems(replace(good, label="thm:nowhere"))[0].endswith("there is no page theorems/thm-nowhere.md")
    assert "does not exist" in problems(replace(good, functions=("inc_casadi.INC.nothing",)))[0]
    assert "does not exist" in problems(replace(good, tests=("tests/theorems/test_thm_wellposed.py::test_nothing",)))[0]
    assert "does not exist" in problems(replace(good, tests=("tests/no_file.py::test_nothing",)))[0]
    other = ("tests/test_readme.py::test_the_second_block_proves_what_is_printed",)
    assert "mentions the label" in problems(replace(good, tests=other))[0]
    assert "at least one function" in problems(replace(good, functions=()))[0]


def test_every_test_that_any_page_names_exists():
    pages = [page.read_text(encoding="utf-8") for page in SITE.rglob("*.md")]
    named = {name for page in pages for name in re.findall(r"tests/[\w/]+\.py::\w+", page)}
    named |= {test for theorem in THEOREMS.values() for test in theorem.tests}
    for test in named:
        file, name = registry().parts(test)
        assert name in registry().tests_of(file), test


def test_the_named_tests_are_collected():
    named = sorted({test for theorem in THEOREMS.values() for test in theorem.tests})
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", "-m", "", *named]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stdout[-2000:]


def test_every_public_name_is_in_the_reference():
    import benchmarks
    import inc_casadi
    import inc_casadi.errors
    import synthesis

    text = "\n".join(page.read_text(encoding="utf-8") for page in (SITE / "api").glob("*.md"))
    described = re.findall(r"^\.\. auto\w+:: ([\w.]+)", text, re.MULTILINE)
    listed = {name.rpartition(".")[2] for name in described}
    packages = [importlib.import_module(found.name) for top in (inc_casadi, synthesis, benchmarks)
                for found in pkgutil.walk_packages(top.__path__, f"{top.__name__}.")
                if found.ispkg or found.name == "inc_casadi.types"]
    public = {name for package in (inc_casadi, synthesis, *packages) for name in getattr(package, "__all__", ())}
    public |= {name for name, value in vars(inc_casadi.errors).items() if isinstance(value, type)}
    assert not public - listed - UNLISTED
    assert len(described) == len(set(described)) and all(registry().exists(name) for name in described)
