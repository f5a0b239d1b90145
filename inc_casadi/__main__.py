"""`python -m inc_casadi check FILE`: verify a saved certificate with NumPy alone, without any solver."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from .certificate import Certificate, MatrixCertificate, Proof
from .ellipsoid_certificate import EllipsoidCertificate
from .errors import FormatError, INCError
from .interchange import load


def main(arguments: list[str] | None = None) -> int:
    """Print what a saved certificate proves, and by which rigorous means; return the exit status.

    The status is 0 only when the certificate holds and its rigorous proof succeeds, 1 when not, 2 when the file cannot
    be read or holds no certificate. With --exact, matrix inequalities are settled in rational arithmetic, where
    otherwise floating point with every rounding bounded is tried first; both are proofs.

    arguments: what follows `python -m inc_casadi`; None stands for those of the command line.

    >>> main(["check", "no-such-file.json"])
    2
    """
    parser = argparse.ArgumentParser(prog="python -m inc_casadi")
    commands = parser.add_subparsers(dest="command", required=True)
    check = commands.add_parser("check", help="verify a saved certificate without any solver")
    check.add_argument("file", type=Path, help="what Certificate.save or Result.save wrote")
    check.add_argument("--exact", action="store_true", help="settle matrix inequalities in rational arithmetic; slower")
    options = parser.parse_args(arguments)
    try:
        certificate = read_certificate(options.file)
    except (INCError, OSError) as error:
        print(f"cannot be read: {error}", file=sys.stderr)
        return 2
    print(certificate.sentence)
    if not certificate.holds():
        return 1
    proof = prove(certificate, exactly=options.exact)
    if proof:
        print(f"Proved by {proof.method} in {proof.seconds:.3g} s.")
        return 0
    print(f"Not proved by {proof.method} in {proof.seconds:.3g} s: {proof.reason}.")
    return 1


def read_certificate(path: Path) -> Certificate:
    """Return the certificate that a file holds, by itself or as the entry "certificate" of a saved result.

    Raises FormatError when the file is not of this toolbox, was altered, or holds no certificate; OSError when it
    cannot be read.

    >>> read_certificate(Path("no-such-file.json"))
    Traceback (most recent call last):
        ...
    FileNotFoundError: [Errno 2] No such file or directory: 'no-such-file.json'
    """
    found = load(path)
    certificate = found.get("certificate") if isinstance(found, dict) else found
    if not isinstance(certificate, Certificate):
        raise FormatError(f"{path} holds no certificate, but {type(found).__name__}")
    return certificate


def prove(certificate: Certificate, *, exactly: bool) -> Proof:
    """Return the rigorous proof of a certificate; `exactly` asks for rational arithmetic where there is a choice.

    Only matrix inequalities offer a choice: other certificates take the cheapest means that suffices by themselves.

    >>> from inc_casadi import INC, Plant, Stability
    >>> loop = Plant([[0.5]], [[1.0]]), INC.linear([[0.0]])
    >>> bool(prove(MatrixCertificate(*loop, Stability(0.6), "sector", {"P": [[1.0]], "Lambda": []}), exactly=False))
    True
    """
    if exactly and isinstance(certificate, MatrixCertificate | EllipsoidCertificate):
        return certificate.prove(method="exact")
    return certificate.prove()


if __name__ == "__main__":
    sys.exit(main())
