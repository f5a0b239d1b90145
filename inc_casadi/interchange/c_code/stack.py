"""How many bytes of stack the C of a law takes at most, read from its own text along the deepest chain of calls."""

from __future__ import annotations

import re
from collections.abc import Sequence

FRAME = 320  # bytes per call for scalars, saved registers and spilled values; gcc 12 for x86-64 stays below it
SIZES = {"double": 8, "float": 4, "int": 4}
HEAD = re.compile(r"^(?:static )?(?:int|void|double|float) (\w+)\(")
DECLARED = re.compile(r"^\s*(double|float|int|pattern_\d+) (?!\w+\()(.*);")


def frames(text: Sequence[str]) -> dict[str, tuple[int, frozenset[str]]]:
    """Return, for each function of a source, the bytes of its arrays and the functions that it calls.

    >>> frames(["static int f(void)", "{", "    double z[3], s;", "    return g(z);", "}"])
    {'f': (24, frozenset({'g'}))}
    """
    found, structures, at = {}, dict(SIZES), 0
    for k, line in enumerate(text):
        if line.startswith("typedef struct {"):
            at = k
        elif closed := re.match(r"} (\w+);", line):
            structures[closed.group(1)] = sum(_bytes(part, structures) for part in text[at + 1: k])
        elif (head := HEAD.match(line)) and not line.rstrip().endswith(";"):
            end = next(j for j in range(k, len(text)) if text[j] == "}")
            body = text[k + 1: end]
            names = {name for part in body for name in re.findall(r"\b(\w+)\(", part)}
            found[head.group(1)] = sum(_bytes(part, structures) for part in body), frozenset(names - {head.group(1)})
    return found


def _bytes(line: str, sizes: dict[str, int]) -> int:
    declared = DECLARED.match(line)
    if declared is None:
        return 0
    kind, rest = declared.groups()
    if kind not in SIZES:
        return sizes.get(kind, 0)
    return sizes[kind] * sum(int(size) for size in re.findall(r"\w\[(\d+)\]", rest.split("=")[0]))


def deepest(found: dict[str, tuple[int, frozenset[str]]], name: str, frame: int) -> int:
    """Return the bytes along the deepest chain of calls from a function, so many added to the arrays of each.

    >>> deepest({"f": (24, frozenset({"g", "tanh"})), "g": (8, frozenset())}, "f", 100)
    232
    """
    own, calls = found[name]
    return own + frame + max((deepest(found, other, frame) for other in calls if other in found), default=0)


def stack(text: Sequence[str], name: str) -> int:
    """Return a bound on the stack that a call of the function takes: arrays of the deepest chain, and `FRAME` per call."""
    return deepest(frames(text), name, FRAME)
