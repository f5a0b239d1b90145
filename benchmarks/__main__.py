"""`python -m benchmarks paper | bounds | speed [certify | pieces | training] | main`: a table; 1 if a target is missed."""

from __future__ import annotations

import argparse
import sys

from inc_casadi.errors import InvalidInputError

from . import bounds, paper, speed


def main(arguments: list[str] | None = None) -> int:
    """Print the table that is asked for and return the exit status.

    paper: the paper's figures beside computed ones, and its two pictures of separation where --figures says. bounds: for
    every plant of the suite, or one, lower bounds of classes of controllers beside the costs of the best found, in some
    minutes; status 1 where a bound exceeds a certified cost of its class. speed: all measurements but three. `speed certify`
    measures the search for certificates against CVXPY with Clarabel in some minutes, `speed pieces` exact walks against n,
    m and q in one, `speed training` the forms of training in four, or --quick. main: the main job alone.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("what", choices=("paper", "bounds", "speed", "main"))
    parser.add_argument("part", nargs="?", choices=("certify", "pieces", "training"), help="of speed: one measurement alone")
    parser.add_argument("--figures", metavar="DIR", help="of paper: a folder to draw its pictures of separation into")
    parser.add_argument("--plant", metavar="NAME", help="of bounds: one plant of the suite alone")
    parser.add_argument("--quick", action="store_true", help="of speed training: two sizes, a second for each run")
    options = parser.parse_args(arguments)
    what = options.what
    if options.quick and options.part != "training":
        parser.error("--quick belongs to speed training")
    for value, place in ((options.part, "speed"), (options.figures, "paper"), (options.plant, "bounds")):
        if value is not None and what != place:
            parser.error(f"{what} has no part {value!r}")
    if options.part == "certify":
        rows = speed.certification()
        print(speed.certification_table(rows), end="\n\n")
        measured = speed.certification_targets(rows)
        print(speed.table(measured))
        return int(any(one.verdict == "MISS" for one in measured))
    if options.part == "pieces":
        print(speed.pieces_table(speed.pieces()))
        return 0
    if options.part == "training":
        print(speed.training_table(speed.quick_training() if options.quick else speed.training()))
        return 0
    if what == "bounds":
        try:
            return bounds.report(bounds.lines(bounds.chosen(options.plant)))
        except InvalidInputError as error:
            parser.error(str(error))
    if what == "paper":
        return _paper(options.figures)
    measured = speed.main_job()
    if what == "speed":
        measured = [*speed.imports(), *speed.exact_cost(), *measured, *speed.evaluation()]
    print(speed.table(measured))
    return int(any(one.verdict == "MISS" for one in measured))


def _paper(folder: str | None) -> int:
    figures = paper.all_rows()
    print(paper.report(figures))
    if folder is not None:
        for path in paper.draw_all(folder):
            print(f"drawn: {path}")
    return int(not all(row.agrees for row in figures))


if __name__ == "__main__":
    sys.exit(main())
