"""Docstrings become reStructuredText: mathematics is left as it is, labels and names become links."""

import importlib
import sys
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="the documentation site needs Sphinx: pip install sphinx myst-nb furo")


@pytest.fixture(scope="module")
def site():
    """The module, imported from the site's folder, which is no package."""
    folder = str(Path(__file__).parents[1] / "examples" / "site")
    sys.path.append(folder)
    try:
        yield importlib.import_module("site_docstrings")
    finally:
        sys.path.remove(folder)


def test_mathematics_is_escaped(site):
    assert site.plain("x*'P x* with |W| and u_") == r"x\*'P x\* with \|W\| and u\_"


def test_code_becomes_literal_and_described_names_become_links(site):
    assert site.prose("a `step` here") == "a \\ ``step``\\  here"
    assert ":py:obj:`certify <inc_casadi.certify>`" in site.prose("by `certify`")
    assert ":py:obj:`INC.linear <inc_casadi.INC.linear>`" in site.prose("by `INC.linear`")
    assert ":py:obj:`DimensionError <inc_casadi.errors.DimensionError>`" in site.prose("Raises DimensionError when")


def test_labels_link_to_the_theorem_that_explains_them(site):
    assert ":ref:`thm:performance <thm:performance>`" in site.prose("(thm:performance)")
    assert ":ref:`eq:Jlin_star <thm:general_superiority>`" in site.prose("eq:Jlin_star")
    assert site.prose("eq:nowhere") == "eq:nowhere"


def test_formulas_and_tables_become_literal_blocks(site):
    out = site.converted(["A sum:", "", "    sum_k |u_k|^2", "", "one     1", "two     2", "", "end"])
    assert out.count(".. code-block:: text") == 2 and "    sum_k |u_k|^2" in out and "    two     2" in out


def test_sections_become_lists_and_examples_stay(site):
    out = site.converted(["Return.", "", "Parameters", "----------", "a : first", "    and more", "b, c : others", "",
                          "Raises", "------", "DimensionError : shapes", "", "Examples", "--------", ">>> 1 * 1", "1"])
    text = "\n".join(out)
    assert ":Parameters:\n\n    - **a** – first\n      and more\n\n    - **b**, **c** – others" in text
    assert ":Raises:" in text and "inc_casadi.errors.DimensionError" in text
    assert ".. rubric:: Examples\n\n>>> 1 * 1\n1" in text


def test_bullets_stay_bullets(site):
    out = site.converted(["Two:", "", "* one |W|", "  goes on", "* two", "", "after"])
    assert out[2:7] == [r"* one \|W\|", "  goes on", "", "* two", ""]


def test_type_aliases_are_named(site):
    arguments = "(x: TypeAliasForwardRef('ArrayLike'))"
    assert site.signature(None, "", "", None, None, arguments, None) == ("(x: ArrayLike)", None)
