"""`python -m benchmarks paper|speed|main`: print a table, and end with status 1 when a figure or a target is missed."""

from __future__ import annotations

import argparse
import sys

from . import paper, speed


def main(arguments: list[str] | None = None) -> int:
    """Print the table that is asked for and return the exit status.

    paper: the paper's figures beside computed ones; speed: all measurements; main: the main job alone.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("what", choices=("paper", "speed", "main"))
    what = parser.parse_args(arguments).what
    if what == "paper":
        rows = paper.all_rows()
        print(paper.report(rows))
        return int(not all(row.agrees for row in rows))
    measured = speed.main_job()
    if what == "speed":
        measured = [*speed.imports(), *speed.exact_cost(), *measured, *speed.evaluation()]
    print(speed.table(measured))
    return int(any(one.verdict == "MISS" for one in measured))


if __name__ == "__main__":
    sys.exit(main())
