"""`python -m inc_casadi check FILE`: verify a saved certificate with NumPy alone, without any solver."""

from __future__ import annotations

import argparse
import sys

from .certificate import Certificate
from .errors import INCError
from .interchange import load


def main(arguments: list[str] | None = None) -> int:
    """Print what a saved certificate proves; exit status 0 when it holds, 1 when it does not, 2 when it is unreadable."""
    parser = argparse.ArgumentParser(prog="python -m inc_casadi")
    commands = parser.add_subparsers(dest="command", required=True)
    check = commands.add_parser("check", help="verify a saved certificate without any solver")
    check.add_argument("file", help="what Certificate.save or Result.save wrote")
    check.add_argument("--exact", action="store_true", help="settle it in exact arithmetic too; slower")
    options = parser.parse_args(arguments)
    try:
        found = load(options.file)
    except (INCError, OSError) as error:
        print(f"cannot be read: {error}", file=sys.stderr)
        return 2
    certificate = found.get("certificate") if isinstance(found, dict) else found
    if not isinstance(certificate, Certificate):
        print(f"{options.file} holds no certificate", file=sys.stderr)
        return 2
    print(certificate.sentence)
    if not certificate.holds():
        return 1
    if options.exact:
        proof = certificate.prove()
        outcome = "proved by" if proof else f"not proved ({proof.reason}) by"
        print(f"{outcome} {proof.method} in {proof.seconds:.2f} s")
        return 0 if proof else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
