"""`python -m inc_casadi check FILE`: verify what a file proves from its numbers, without any solver."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .comparison import Comparison
from .errors import INCError
from .interchange import load
from .interchange.checking import settled, verdicts


def main(arguments: list[str] | None = None) -> int:
    """Print what a saved file proves, and by which rigorous means; return the exit status.

    Files are those of certificates, lower bounds, comparisons and results of `synthesize`. Every certificate and every
    lower bound in them is recomputed and proved; a comparison is then printed with what that gave.

    The status is 0 only when all of them hold and their rigorous proofs succeed, 1 when not, or when a certified cost
    contradicts a lower bound, 2 when the file cannot be read or holds nothing to check. With --exact, matrix inequalities
    are settled in rational arithmetic, where otherwise floating point with every rounding bounded is tried first; both are
    proofs.

    NumPy alone suffices, but for what is stated about polytopes, whose vertices SciPy lists, and for invariance by a
    mixed-integer program, which SciPy solves.

    arguments: what follows `python -m inc_casadi`; None stands for those of the command line.

    >>> main(["check", "no-such-file.json"])
    2
    """
    parser = argparse.ArgumentParser(prog="python -m inc_casadi")
    commands = parser.add_subparsers(dest="command", required=True)
    check = commands.add_parser("check", help="verify saved certificates, bounds and comparisons without any solver")
    check.add_argument("file", type=Path, help="what save(), Certificate.save or Result.save wrote")
    check.add_argument("--exact", action="store_true", help="settle matrix inequalities in rational arithmetic; slower")
    options = parser.parse_args(arguments)
    try:
        return _check(options.file, options.exact)
    except (INCError, OSError) as error:
        print(f"cannot be read: {error}", file=sys.stderr)
    except ImportError as error:
        print(f"cannot be checked without further packages: {error}", file=sys.stderr)
    return 2


def _check(path: Path, exactly: bool) -> int:
    found, judged = load(path), []
    for verdict in verdicts(found, exactly=exactly):
        print(verdict)
        judged.append(verdict)
    passed = all(verdict.passed for verdict in judged)
    if isinstance(found, Comparison):
        print(f"\n{settled(found, judged)}")
        passed = passed and not found.inversions()
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
