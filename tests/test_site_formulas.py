"""Formulas of the site are MathML, made at build time: all of them are understood, and pages fetch nothing to show them."""

import importlib
import json
import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="the documentation site needs Sphinx: pip install 'inc-casadi[docs]'")
math_core = pytest.importorskip("math_core", reason="formulas as MathML need math-core: pip install 'inc-casadi[docs]'")

SITE = Path(__file__).parents[1] / "examples" / "site"


@pytest.fixture(scope="module")
def site():
    """The module, imported from the site's folder, which is no package."""
    sys.path.append(str(SITE))
    try:
        yield importlib.import_module("site_math")
    finally:
        sys.path.remove(str(SITE))


def texts():
    """All Markdown of the site: pages, and cells of notebooks."""
    pages = [page for page in SITE.rglob("*.md") if "build" not in page.relative_to(SITE).parts]
    yield from (page.read_text(encoding="utf-8") for page in pages)
    for notebook in sorted((SITE.parent / "notebooks").glob("*.ipynb")):
        cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
        yield from ("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def formulas():
    """(TeX, whether displayed) of every formula in them."""
    from markdown_it import MarkdownIt
    from mdit_py_plugins.dollarmath import dollarmath_plugin

    reader = MarkdownIt().enable("table").use(dollarmath_plugin)
    for text in texts():
        for token in reader.parse(text):
            yield from ((one.content, False) for one in token.children or () if one.type == "math_inline")
            if token.type in ("math_block", "math_block_label"):
                yield token.content, True


def test_every_formula_is_understood(site):
    found = list(formulas())
    assert len(found) > 500
    assert all(site.mathml(tex.strip(), displayed).startswith("<math") for tex, displayed in found)


@pytest.mark.parametrize(("tex", "content"), [
    (r"\tfrac12", "<mn>1</mn><mn>2</mn>"),  # where some translators read the number 12
    (r"\mathbb E", "𝔼"), (r"\operatorname{tr}", "tr"), (r"a<b", "&lt;"), (r"P\succeq0", "⪰"),
])
def test_what_it_becomes(site, tex, content):
    assert content in site.mathml(tex, False)


def test_an_unknown_command_is_a_warning_which_stops_a_strict_build(site, tmp_path):
    page, said = built(tmp_path, r"Wrong :math:`\nothing<1`.")
    assert r"\nothing&lt;1</code>" in page and r"index.rst:4: WARNING: the formula \nothing<1 is not understood" in said


def test_a_page_fetches_nothing_for_its_formulas(site, tmp_path):
    text = "Here :math:`x'Px<1` and\n\n.. math:: \\beta F^\\top PF\\preceq0\n   :label: one\n\nin :eq:`one`."
    page, said = built(tmp_path, text)
    assert page.count("<math") == 2 and "display=\"block\"" in page and ">(1)" in page and not said
    assert not re.findall(r"""<(?:script|link|img)[^>]*["'](?:https?:)?//""", page) and "mathjax" not in page.lower()


def test_the_settings_choose_it(monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    settings = {"__file__": str(SITE / "conf.py")}
    exec(compile((SITE / "conf.py").read_text(encoding="utf-8"), "conf.py", "exec"), settings)
    assert settings["html_math_renderer"] == "mathml" and "site_math" in settings["extensions"]
    assert not any("mathjax" in name for name in settings["extensions"])


def built(folder, text):
    """The HTML of a page that is built with the renderer, and the warnings."""
    from io import StringIO

    from sphinx.application import Sphinx
    from sphinx.util.docutils import docutils_namespace

    (folder / "index.rst").write_text(f"Title\n=====\n\n{text}\n", encoding="utf-8")
    settings = {"extensions": ["site_math"], "html_math_renderer": "mathml", "html_theme": "basic"}
    warnings = StringIO()
    with docutils_namespace():
        Sphinx(folder, None, folder / "out", folder / "trees", "html", confoverrides=settings, status=None, warning=warnings,
               freshenv=True).build()
    return (folder / "out" / "index.html").read_text(encoding="utf-8"), warnings.getvalue()
