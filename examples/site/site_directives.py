"""Directives of the site: what a theorem rests on, the table of all theorems, lists of examples and notebooks."""

from __future__ import annotations

import ast
from typing import Any

import site_registry
from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective


def code(name: str) -> str:
    """Return a link to the description of a Python object, in Markdown."""
    return f"{{py:obj}}`{name}`"


class TheoremLinks(SphinxDirective):
    """Say for one label: what kind of statement it is, what implements it and what tests it, with the first test's text."""

    required_arguments = 1
    option_spec = {"hide-test": directives.flag}

    def run(self) -> list[nodes.Node]:
        """Return the frame with the links, and the first test."""
        theorem = next((one for one in site_registry.theorems() if one.label == self.arguments[0]), None)
        if theorem is None:
            raise self.error(f"{self.arguments[0]} is not in theorems.toml")
        frame = nodes.container(classes=["theorem-links"])
        frame += self.parse_text_to_nodes("\n".join([
            f"**Label** `{theorem.label}` · **Kind** {theorem.kind}", "",
            "**Implemented by** " + ", ".join(code(name) for name in theorem.functions), "",
            "**Tested by**", "", *(f"- `{test}`" for test in theorem.tests)]))
        if "hide-test" in self.options:
            return [frame]
        file, name = site_registry.parts(theorem.tests[0])
        shown = self.parse_text_to_nodes(
            f"The first of these tests:\n\n```{{literalinclude}} /../../{file}\n:pyobject: {name}\n:language: python\n```")
        return [frame, *shown]


class TheoremTable(SphinxDirective):
    """List all statements: label, what it says, kind, page."""

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        rows = [f"| {{ref}}`{one.title} <{one.label}>` | `{one.label}` | {one.kind} | {len(one.tests)} |"
                for one in site_registry.theorems()]
        head = ["| statement | label | kind | tests |", "|---|---|---|---|"]
        return list(self.parse_text_to_nodes("\n".join(head + rows)))


class ExampleList(SphinxDirective):
    """List the numbered scripts of examples/ with the first line of what they say."""

    def run(self) -> list[nodes.Node]:
        """Return a table of scripts."""
        rows = ["| script | what it shows |", "|---|---|"]
        for path in sorted(site_registry.HERE.parent.glob("[0-9]*.py")):
            self.env.note_dependency(str(path))
            said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            words = " ".join(said.partition("\n\n")[0].split()).replace("|", "\\|")
            rows.append(f"| `examples/{path.name}` | {words} |")
        return list(self.parse_text_to_nodes("\n".join(rows)))


class NotebookList(SphinxDirective):
    """List the notebooks that `site_notebooks` copied, in their order; nothing where there are none."""

    def run(self) -> list[nodes.Node]:
        """Return the table of contents."""
        self.env.note_reread()
        names = sorted(path.stem for path in (site_registry.HERE / "build" / "notebooks").glob("*.ipynb"))
        entries = [f"build/notebooks/{name}" for name in names]
        text = "\n".join(["```{toctree}", ":maxdepth: 1", "", *entries, "```"]) if names else "There are none here."
        return list(self.parse_text_to_nodes(text))


def check(app: Sphinx) -> None:
    """Stop the build when the registry claims what is not there."""
    found = [problem for theorem in site_registry.theorems() for problem in site_registry.problems(theorem)]
    if found:
        raise ExtensionError("theorems.toml:\n" + "\n".join(found))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives and the check."""
    app.add_directive("theorem-links", TheoremLinks)
    app.add_directive("theorem-table", TheoremTable)
    app.add_directive("example-list", ExampleList)
    app.add_directive("notebook-list", NotebookList)
    app.connect("builder-inited", check)
    return {"parallel_read_safe": True}
