"""`python -m benchmarks paper | speed [certify | pieces] | main`: print a table; status 1 where a target is missed."""

from __future__ import annotations

import argparse
import sys

from . import paper, speed


def main(arguments: list[str] | None = None) -> int:
    """Print the table that is asked for and return the exit status.

    paper: the paper's figures beside computed ones; speed: all measurements but two. `speed certify` measures the search for
    certificates against CVXPY with Clarabel in some minutes, `speed pieces` exact walks against n, m and q in one. main: the
    main job alone.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("what", choices=("paper", "speed", "main"))
    parser.add_argument("part", nargs="?", choices=("certify", "pieces"), help="of speed: one measurement alone")
    options = parser.parse_args(arguments)
    what = options.what
    if options.part and what != "speed":
        parser.error(f"{what} has no part {options.part!r}")
    if options.part == "certify":
        rows = speed.certification()
        print(speed.certification_table(rows), end="\n\n")
        measured = speed.certification_targets(rows)
        print(speed.table(measured))
        return int(any(one.verdict == "MISS" for one in measured))
    if options.part == "pieces":
        print(speed.pieces_table(speed.pieces()))
        return 0
    if what == "paper":
        figures = paper.all_rows()
        print(paper.report(figures))
        return int(not all(row.agrees for row in figures))
    measured = speed.main_job()
    if what == "speed":
        measured = [*speed.imports(), *speed.exact_cost(), *measured, *speed.evaluation()]
    print(speed.table(measured))
    return int(any(one.verdict == "MISS" for one in measured))


if __name__ == "__main__":
    sys.exit(main())
