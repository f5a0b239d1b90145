"""The command line of `python -m benchmarks`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from . import commands
from .contest.command import page_command, suite_command

FOLDER = Path("benchmark-results")
EPILOG = "Without a command, or with options alone, the suite is run."
Command = Callable[[argparse.Namespace], int]


def parser() -> argparse.ArgumentParser:
    """Return the parser; `run` of what it returns is the command, a function of the options to the exit status.

    >>> parser().parse_args(["suite", "--plant", "car", "--quick"]).plant
    ['car']
    """
    made = argparse.ArgumentParser(prog="python -m benchmarks", epilog=EPILOG,
                                   description="Measure controllers, bounds and times; status 1 if something is amiss.")
    kinds = made.add_subparsers(required=True, metavar="COMMAND")
    _suite(kinds.add_parser("suite", help="every plant: the synthesized law against all baselines (30 minutes)"))
    _page(kinds.add_parser("page", help="the results page in Markdown, from what the other commands wrote"))
    paper = kinds.add_parser("paper", help="every figure of the paper beside the computed one")
    paper.add_argument("--figures", metavar="DIR", help="a folder to draw its pictures of separation into")
    bounds = kinds.add_parser("bounds", help="every plant between lower bounds and the best found (minutes)")
    bounds.add_argument("--plant", metavar="NAME", help="one plant of the suite alone")
    speed = kinds.add_parser("speed", help="all measured times (8 minutes), or those of one part")
    speed.add_argument("part", nargs="?", choices=commands.PARTS, help="one measurement alone")
    speed.add_argument("--quick", action="store_true", help="of training: two plants, 8 units, two seeds")
    main = kinds.add_parser("main", help="the time of the main job alone")
    for one in (paper, bounds, speed, main):
        one.add_argument("--out", metavar="DIR", type=Path, help="keep the table there, for the results page")
    runs: dict[argparse.ArgumentParser, Command] = {
        paper: lambda o: commands.paper_command(o.figures, o.out), bounds: lambda o: commands.bounds_command(o.plant, o.out),
        speed: _speed, main: lambda o: commands.main_command(o.out)}
    for one, run in runs.items():
        one.set_defaults(run=run)
    return made


def with_default(arguments: list[str]) -> list[str]:
    """Return arguments with `suite` in front when they begin with none, or with an option of it.

    >>> with_default([]), with_default(["--quick"]), with_default(["paper"]), with_default(["-h"])
    (['suite'], ['suite', '--quick'], ['paper'], ['-h'])
    """
    bare = not arguments or (arguments[0].startswith("-") and arguments[0] not in ("-h", "--help"))
    return ["suite", *arguments] if bare else arguments


def _suite(one: argparse.ArgumentParser) -> None:
    one.add_argument("--plant", metavar="NAME", nargs="+", default=[], help="these plants alone")
    one.add_argument("--only", metavar="NAME", nargs="+", default=[], help="'synthesized', 'memory' or names of baselines")
    one.add_argument("--quick", action="store_true", help="small budgets, and five plants unless some are named")
    place = one.add_mutually_exclusive_group()
    place.add_argument("--jobs", metavar="N", type=int, help="plants at the same time (as many as cores)")
    place.add_argument("--dask", metavar="ADDRESS", default="", help="of a Dask scheduler to compute on")
    one.add_argument("--seed", type=int, default=0, help="of all random choices (0)")
    one.add_argument("--out", metavar="DIR", type=Path, default=FOLDER, help=f"for all results ({FOLDER})")
    again = one.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_false", dest="fresh", default=False,
                       help="skip what a former run of the same code, seed and settings has measured (the default)")
    again.add_argument("--fresh", action="store_true", help="measure everything anew")
    one.set_defaults(run=lambda o: suite_command(o.out, o.plant, o.only, quick=o.quick, seed=o.seed, jobs=o.jobs,
                                                 dask=o.dask, fresh=o.fresh))


def _page(one: argparse.ArgumentParser) -> None:
    one.add_argument("--out", metavar="FILE", type=Path, default=Path("RESULTS.md"), help="the page (RESULTS.md)")
    one.add_argument("--records", metavar="DIR", type=Path, default=FOLDER, help=f"where the results are ({FOLDER})")
    one.set_defaults(run=lambda o: page_command(o.records, o.out))


def _speed(options: argparse.Namespace) -> int:
    if options.quick and options.part != "training":
        parser().error("--quick belongs to speed training")
    return commands.speed_command(options.part, options.quick, options.out)
