"""Docstrings for Sphinx: mathematics in plain text is left as it is, sections become lists, labels and names become links.

The docstrings of the project are written for the terminal: x'P x, |W|, x*, rho^2. In reStructuredText `|`, `*` and `_` mean
something else, so they are escaped; indented formulas and tables become literal blocks.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import site_registry
from sphinx.application import Sphinx

LISTED = ("Parameters", "Attributes", "Returns", "Yields", "Raises", "Warns")
SECTIONS = (*LISTED, "Notes", "Examples", "References", "See Also")
BULLET = re.compile(r"^\s*([*-]|\d+\.) ")
CODE = re.compile(r"``.+?``|`[^`]+`", re.DOTALL)
WORDS = re.compile(r"\b(?:thm|prop|cor|ass|eq):\w+|\b(?=\w*[a-z])[A-Z][a-z0-9]*[A-Z]\w*\b")
DESCRIBED = re.compile(r"^\.\. auto(?:class|function|exception|data)(?:::|:) ([\w.]+)", re.MULTILINE)


@cache
def labels() -> dict[str, str]:
    """Return the theorem that explains each label of the paper."""
    found = {}
    for theorem in site_registry.theorems():
        found.update(dict.fromkeys((theorem.label, *theorem.equations), theorem.label))
    return found


@cache
def described() -> dict[str, str]:
    """Return the full name of each described object by its last word, and by its last two; ambiguous words are left out."""
    names = [name for page in sorted((site_registry.HERE / "api").glob("*.md"))
             for name in DESCRIBED.findall(page.read_text(encoding="utf-8"))]
    last = [name.rpartition(".")[2] for name in names]
    found = {word: name for word, name in zip(last, names, strict=True) if last.count(word) == 1}
    return found | {".".join(name.split(".")[-2:]): name for name in names}


def link(word: str) -> str | None:
    """Return a link for a label or a described name, else None."""
    if word in labels():
        return f"\\ :ref:`{word} <{labels()[word]}>`\\ "
    head, _, attribute = word.partition(".")
    name = described().get(word) or (f"{described()[head]}.{attribute}" if attribute and head in described() else None)
    return f"\\ :py:obj:`{word} <{name}>`\\ " if name else None


def escaped(text: str) -> str:
    """Return prose with its markup characters escaped."""
    return re.sub(r"([\\*|_`])", r"\\\1", text)


def prose(text: str) -> str:
    """Return a stretch of prose as reStructuredText; its bullets stay."""
    out, at = [], 0
    for span in CODE.finditer(text):
        out += [plain(text[at:span.start()]), literal(span.group().strip("`"))]
        at = span.end()
    return "".join([*out, plain(text[at:])])


def plain(text: str) -> str:
    """Return prose without code spans: labels and names linked, the rest escaped."""
    out, at = [], 0
    for word in WORDS.finditer(text):
        if linked := link(word.group()):
            out += [escaped(text[at:word.start()]), linked]
            at = word.end()
    return "".join([*out, escaped(text[at:])])


def literal(text: str) -> str:
    """Return a code span, linked where the object is described."""
    text = " ".join(text.split())
    return link(text.removesuffix("()")) or f"\\ ``{text}``\\ "


def blocks(lines: list[str]) -> list[list[str]]:
    """Return paragraphs: runs of lines that are not blank."""
    found: list[list[str]] = [[]]
    for line in lines:
        if line.strip():
            found[-1].append(line.rstrip())
        elif found[-1]:
            found.append([])
    return [block for block in found if block]


def indent(line: str) -> int:
    """Return the number of leading spaces."""
    return len(line) - len(line.lstrip())


def is_table(block: list[str]) -> bool:
    """Return whether the lines are columns."""
    return sum(bool(re.search(r"\S {3,}\S", line)) for line in block) >= 2


def rendered(block: list[str], in_list: bool) -> list[str]:
    """Return one paragraph as reStructuredText."""
    if block[0].lstrip().startswith(">>>"):
        return [*block, ""]
    if is_table(block) or indent(block[0]) >= 4 and not in_list:
        room = min(indent(line) for line in block)
        return [".. code-block:: text", "", *(f"    {line[room:]}" for line in block), ""]
    out: list[str] = []
    for item in items(block):
        mark = BULLET.match(item[0])
        head, margin = (mark.group(), len(mark.group())) if mark else (" " * indent(item[0]), indent(item[0]))
        text = prose("\n".join([item[0][len(head):], *(line.strip() for line in item[1:])])).split("\n")
        out += [head + text[0], *(" " * margin + line for line in text[1:])]
        if mark:
            out.append("")
    return [*out, ""]


def items(block: list[str]) -> list[list[str]]:
    """Return the lines of a paragraph cut before each bullet."""
    found: list[list[str]] = []
    for line in block:
        if not found or BULLET.match(line):
            found.append([])
        found[-1].append(line)
    return found


def listed(lines: list[str]) -> list[str]:
    """Return the entries `name : text` of a section as bullets."""
    out: list[str] = []
    for line in lines:
        if line.strip() and indent(line) == 0:
            name, colon, text = line.partition(" : ")
            shown = ", ".join(link(word) or f"**{escaped(word)}**" for word in name.split(", "))
            out += ["", f"    - {shown} {prose('– ' + text) if colon else ''}".rstrip()]
        elif line.strip():
            out.append(f"      {prose(line.strip())}")
    return [*out, ""]


def sections(lines: list[str]) -> list[tuple[str, list[str]]]:
    """Return the lines under each heading; the first has none."""
    found: list[tuple[str, list[str]]] = [("", [])]
    skip = False
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if skip:
            skip = False
        elif line.strip() in SECTIONS and following.strip() and not following.strip().strip("-"):
            found.append((line.strip(), []))
            skip = True
        else:
            found[-1][1].append(line)
    return found


def converted(lines: list[str]) -> list[str]:
    """Return a docstring as reStructuredText."""
    out: list[str] = []
    for heading, body in sections(lines):
        if heading in LISTED:
            out += [f":{heading}:", *listed(body)]
            continue
        if heading:
            out += [f".. rubric:: {heading}", ""]
        in_list = False
        for block in blocks(body):
            out += rendered(block, in_list)
            in_list = bool(BULLET.match(block[0])) or in_list and indent(block[0]) > 0
    return out


def process(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Rewrite a docstring in place."""
    lines[:] = converted(lines) if lines and not lines[0].startswith("Alias for field number") else []


def signature(app: Sphinx, what: str, name: str, value: Any, options: Any, arguments: str | None,
              returned: str | None) -> tuple[str | None, str | None]:
    """Name type aliases as they are written."""
    def named(text: str | None) -> str | None:
        return text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)

    return named(arguments), named(returned)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the rewriting."""
    app.connect("autodoc-process-docstring", process)
    app.connect("autodoc-process-signature", signature)
    return {"parallel_read_safe": True}
