"""What a file proves: its certificates and lower bounds, each judged anew from its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from ..admissible_set import AdmissibleSet
from ..bounds import Bound
from ..certificate import Certificate, MatrixCertificate, Proof
from ..comparison import Comparison
from ..comparison.comparison import label
from ..ellipsoid_certificate import EllipsoidCertificate
from ..errors import FormatError, INCError
from ..pieces.difference import Difference
from ..pieces.scale import Scale

TITLES = {"certificate": "", "bounds": "lower bound"}
"""What the parts of a saved result are called; others by their name in the file."""

NONE_FOUND = "Not certified: the result has no certificate."

_FORGED = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError)  # where numbers do not fit together


@dataclass(frozen=True, eq=False)
class Verdict:
    """What became of one thing in a file.

    name: what it is called there, empty when the file is that thing; sentence: what it states, or that it does not; holds:
    whether its numbers prove it; proof: how it was settled rigorously, or why not, None when it does not even hold.
    """

    name: str
    sentence: str
    holds: bool
    proof: Proof | None

    @property
    def passed(self) -> bool:
        """Whether it holds and is proved."""
        return self.holds and bool(self.proof)

    def __str__(self) -> str:
        head = f"{self.name}: {self.sentence}" if self.name else self.sentence
        if self.proof is None:
            return head
        means = f"by {self.proof.method} in {self.proof.seconds:.3g} s"
        return f"{head}\n" + (f"Proved {means}." if self.proof else f"Not proved {means}: {self.proof.reason}.")


def verdicts(found: Any, *, exactly: bool = False) -> Iterator[Verdict]:
    """Judge all certificates and lower bounds that a file holds, one after the other.

    A comparison's are those of its controllers and classes; of a saved result, those of the law that was taken and the
    bounds, not those of every attempt.

    exactly: settle matrix inequalities in rational arithmetic, where otherwise floating point with every rounding bounded
    is tried first.
    Raises FormatError when it holds none, ImportError where a package that a claim needs is missing.

    >>> from inc_casadi import INC, Box, Plant, Stability, Spec, bounds
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> [one.passed for one in verdicts({"bounds": {"linear": bounds.first_move(Plant(1.5, 1.0), spec)}})]
    [True]
    """
    judged = False
    for name, one in _claims("", found):
        judged = True
        yield _judged(name, one, exactly)
    if not judged:
        raise FormatError(f"it holds no certificate, no lower bound and no comparison, but {type(found).__name__}")


def prove(claim: Any, *, exactly: bool = False) -> Proof:
    """Return the rigorous proof of a certificate or bound; `exactly` asks for rational arithmetic where there is a choice.

    Only matrix inequalities offer a choice: others take the cheapest means that suffices by themselves.

    >>> from inc_casadi import INC, Plant, Stability
    >>> loop = Plant([[0.5]], [[1.0]]), INC.linear([[0.0]])
    >>> bool(prove(MatrixCertificate(*loop, Stability(0.6), "sector", {"P": [[1.0]], "Lambda": []}), exactly=False))
    True
    """
    if exactly and isinstance(claim, MatrixCertificate | EllipsoidCertificate):
        return claim.prove(method="exact")
    return claim.prove()


def settled(comparison: Comparison, found: Iterable[Verdict]) -> Comparison:
    """Return a comparison whose table and sentences speak of what the verdicts on it say, and of no proof recorded before.

    >>> from inc_casadi import INC, Box, Plant, Spec, compare
    >>> spec = Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1), inputs=Box(-1, 1))
    >>> law = {"clipped": INC.saturated([[-1.5]], 1.0)}
    >>> comparison = compare(Plant(1.5, 1.0), spec, law, bounds=["linear"])
    >>> settled(comparison, verdicts(comparison)).statements[0].claim.endswith("both are proved.")
    True
    """
    proofs: dict[str, Proof] = {}
    for one in found:
        before = proofs.get(one.name, Proof(True, "", 0.0))
        now = one.proof or Proof(False, "none", 0.0, one.sentence)
        if before:
            means = ", ".join(dict.fromkeys(filter(None, [*before.method.split(", "), now.method])))
            proofs[one.name] = Proof(bool(now), means, before.seconds + now.seconds, now.reason)
    return replace(comparison, proofs=MappingProxyType(proofs))


def _claims(name: str, found: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(found, Comparison):
        yield from ((_title(name, row.name), one) for row in found.rows for one in row.evidence)
        yield from ((_title(name, label(floor)), floor.bound) for floor in found.floors if floor.bound is not None)
    elif isinstance(found, Mapping):
        for key, entry in found.items():
            nothing = key == "certificate" and entry is None
            yield from _claims(_title(name, TITLES.get(key, str(key))), NONE_FOUND if nothing else entry)
    elif isinstance(found, Scale):
        yield name, found.certificate
    elif found is NONE_FOUND or isinstance(found, Certificate | Bound | AdmissibleSet | Difference):
        yield name, found


def _title(*names: str) -> str:
    return ", ".join(filter(None, names))


def _judged(name: str, claim: Any, exactly: bool) -> Verdict:
    if claim is NONE_FOUND:
        return Verdict(name, NONE_FOUND, False, None)
    try:
        sentence, holds = _stated(claim)
        return Verdict(name, sentence, holds, prove(claim, exactly=exactly) if holds else None)
    except _FORGED as error:
        return Verdict(name, f"Not certified: its numbers do not fit together ({error}).", False, None)
    except INCError as error:
        return Verdict(name, f"Not certified: {error}.", False, None)


def _stated(claim: Any) -> tuple[str, bool]:
    """What a claim says, and whether its numbers prove it in floating point."""
    if isinstance(claim, Bound):
        holds = claim.holds()
        return claim.statement if holds else f"Not confirmed: its numbers do not prove {claim.value:.7g}.", holds
    if isinstance(claim, AdmissibleSet):  # without an answer in floats: `prove` alone decides
        return "Every motion from the polytope keeps the constraints for ever.", True
    if isinstance(claim, Difference):
        return claim.sentence, True
    return claim.sentence, claim.holds()
