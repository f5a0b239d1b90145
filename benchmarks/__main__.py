"""`python -m benchmarks paper | bounds | speed [part] | main`: a table; status 1 if a target is missed."""

from __future__ import annotations

import argparse
import sys

from inc_casadi.errors import InvalidInputError

from . import bounds, paper, speed

PARTS = ("certify", "pieces", "training", "alternation")


def main(arguments: list[str] | None = None) -> int:
    """Print the table that is asked for and return the exit status.

    paper: the paper's figures beside computed ones, and its two pictures of separation where --figures says. bounds: for
    every plant of the suite, or one, lower bounds of classes of controllers beside the costs of the best found, in some
    minutes; status 1 where a bound exceeds a certified cost of its class. speed: all measurements but four. `speed certify`
    measures the search for certificates against CVXPY with Clarabel in some minutes, `speed pieces` exact walks against n,
    m and q in one, `speed training` the forms of training in four, or --quick, `speed alternation` certified costs before
    and after retraining in half a minute. main: the main job alone.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("what", choices=("paper", "bounds", "speed", "main"))
    parser.add_argument("part", nargs="?", choices=PARTS, help="of speed: one measurement alone")
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
    if options.part is not None:
        return _part(options.part, options.quick)
    if what == "bounds":
        try:
            return bounds.report(bounds.lines(bounds.chosen(options.plant)))
        except InvalidInputError as error:
            parser.error(str(error))
    if what == "paper":
        return _paper(options.figures)
    measured = speed.main_job()
    return _judged([*speed.imports(), *speed.exact_cost(), *measured, *speed.evaluation()] if what == "speed" else measured)


def _part(part: str, quick: bool) -> int:
    if part == "certify":
        rows = speed.certification()
        print(speed.certification_table(rows), end="\n\n")
        return _judged(speed.certification_targets(rows))
    if part == "pieces":
        print(speed.pieces_table(speed.pieces()))
    elif part == "training":
        print(speed.training_table(speed.quick_training() if quick else speed.training()))
    else:
        print(speed.alternation_table(speed.alternation()))
    return 0


def _judged(measured: list[speed.Measurement]) -> int:
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
