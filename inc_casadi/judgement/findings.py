"""What one way of proof says of a law: what it proves, with the certificate, or why it proves nothing."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import inf, nan
from typing import Any

from ..certificate import Certificate
from ..inc import INC
from ..output_range import within_limits
from ..pieces.walk import Budget
from ..plant import Plant
from ..spec import Spec
from .causes import Cause

BUILT_IN = "the range of the activations"


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of every way of proof.

    plant, spec, inc: what it is about; budget: of a way that takes long; alone: only what one certificate proves by itself,
    and nothing that no acceptance depends on.
    """

    plant: Plant
    spec: Spec
    inc: INC
    budget: Budget
    alone: bool = False

    @cached_property
    def built_in(self) -> bool:
        """Whether there are no input limits, or no output of the law can leave them, whatever it measures."""
        return self.spec.inputs is None or within_limits(self.inc, self.spec.inputs)


@dataclass(frozen=True, eq=False)
class Passed:
    """A bound on the expected cost that holds, and what else is proved with it.

    Parameters
    ----------
    way : of proof, in words
    certificate : it holds, and its `bound` is the expected cost at most
    cost : what the bound rests on, in words
    limits : why the input limits are kept, "" where that is not proved
    converges : why every motion converges, "" where that is not proved
    worst : the largest cost at most, NaN where it is not known
    exact : whether the bound is the cost itself, up to rounding
    by_worst : whether it bounds the expected cost by the largest only, which another way may undercut
    loose : whether it may be far above the cost, so that other ways are asked too
    grounds : certificates other than the first that `limits` rests on
    proofs : the same in the words of a report
    short : what is not proved of what was asked, each with its reason
    """

    way: str
    certificate: Certificate
    cost: str
    limits: str = ""
    converges: str = ""
    worst: float = nan
    exact: bool = False
    by_worst: bool = False
    loose: bool = False
    grounds: tuple[Certificate, ...] = ()
    proofs: tuple[str, ...] = ()
    short: tuple[str, ...] = ()

    @property
    def bound(self) -> float:
        """The expected cost at most where the limits are kept too; infinite otherwise."""
        return self.certificate.bound if self.limits else inf


@dataclass(frozen=True, eq=False)
class Refused:
    """Why one way of proof gives nothing.

    way: in words; why: the reason; cause: the same, of a fixed list; certificate: the one that fails, or None.
    """

    way: str
    why: str
    cause: Cause
    certificate: Any = field(default=None, repr=False)

    @property
    def reason(self) -> str:
        """The reason, with the way of proof.

        >>> Refused("exact pieces", "no time", Cause.TIME).reason
        'exact pieces: no time'
        """
        return f"{self.way}: {self.why}"


Finding = Passed | Refused
