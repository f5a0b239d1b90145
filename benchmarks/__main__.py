"""`python -m benchmarks [suite | page | paper | bounds | speed [part] | main]`; --help tells more."""

from __future__ import annotations

import sys

from inc_casadi.errors import INCError

from .options import parser, with_default


def main(arguments: list[str] | None = None) -> int:
    """Run the command that is asked for, the suite when none is, and return the exit status.

    arguments : those of the command line when None
    """
    reader = parser()
    options = reader.parse_args(with_default(sys.argv[1:] if arguments is None else arguments))
    try:
        status: int = options.run(options)
    except INCError as error:
        reader.error(str(error))
    return status


if __name__ == "__main__":
    sys.exit(main())
