"""The registry of published statements: where each is explained, implemented and tested, and what is wrong with an entry."""

from __future__ import annotations

import ast
import importlib
import tomllib
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]


@dataclass(frozen=True)
class Theorem:
    """One published statement.

    label, title : as the paper has them, and what it is about; kind : "sufficient", "exact", ...; functions : full names of
    what implements it; tests : node ids of what checks it; equations : labels of equations that its page explains.
    """

    label: str
    title: str
    kind: str
    functions: tuple[str, ...]
    tests: tuple[str, ...]
    equations: tuple[str, ...] = ()

    @property
    def page(self) -> str:
        """The page's name, without suffix."""
        return f"theorems/{self.label.replace(':', '-')}"


def theorems(path: Path = HERE / "theorems.toml") -> tuple[Theorem, ...]:
    """Return the registry in its order."""
    entries = tomllib.loads(path.read_text(encoding="utf-8"))["theorem"]
    return tuple(Theorem(**{key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()})
                 for entry in entries)


def problems(theorem: Theorem) -> list[str]:
    """Return what an entry claims and the project does not bear out: a page, functions, tests that name the label."""
    found = [] if (HERE / f"{theorem.page}.md").is_file() else [f"{theorem.label}: there is no page {theorem.page}.md"]
    found += [f"{theorem.label}: {name} does not exist" for name in theorem.functions if not exists(name)]
    if not theorem.functions or not theorem.tests:
        found.append(f"{theorem.label}: at least one function and one test must be named")
    for test in theorem.tests:
        file, name = parts(test)
        if name not in tests_of(file):
            found.append(f"{theorem.label}: {test} does not exist")
        elif theorem.label.partition(":")[2] not in name and theorem.label not in (ROOT / file).read_text(encoding="utf-8"):
            found.append(f"{theorem.label}: neither {file} nor the name of the test mentions the label")
    return found


def exists(name: str) -> bool:
    """Return whether a dotted name leads to something: the longest importable module, then attributes."""
    words = name.split(".")
    for cut in range(len(words), 0, -1):
        try:
            value = importlib.import_module(".".join(words[:cut]))
        except ModuleNotFoundError:
            continue
        for word in words[cut:]:
            if not hasattr(value, word):
                return False
            value = getattr(value, word)
        return True
    return False


def parts(test: str) -> tuple[str, str]:
    """Return the file of a node id, relative to the root, and the function."""
    file, _, name = test.partition("::")
    return file, name


def tests_of(file: str) -> set[str]:
    """Return the names of the test functions of a file; none when there is no such file."""
    path = ROOT / file
    if not path.is_file():
        return set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.startswith("test")}
