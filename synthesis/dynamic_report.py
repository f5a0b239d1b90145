"""The table of a controller with memory."""

from __future__ import annotations

import numpy as np

from inc_casadi.dynamic import DynamicCertificate
from inc_casadi.figures import at_most

from .dynamic_result import DynamicResult, is_exact
from .progress import counted
from .report import lower, rigour, simulated, written
from .result import CERTIFIED


def table(result: DynamicResult) -> str:
    """Return the result as lines of "what  figure": status, proofs, costs, bounds, times, and the sentence that follows."""
    rows: list[tuple[str, str]] = [("status", result.status.upper() if result.status == CERTIFIED else result.status)]
    if result.chosen is not None and result.dynamic is not None:
        size = f"{counted(result.dynamic.order, 'state')} of its own, {counted(result.dynamic.q, 'hidden unit')}"
        rows.append(("controller", f"{result.chosen.name}: {size}"))
    rows += _proofs(result) + _costs(result)
    rows += lower(result)
    rows += [("search", result.ended)] if result.ended else []
    rows += [("note", note) for note in result.notes]
    return written(rows, result)


def _proofs(result: DynamicResult) -> list[tuple[str, str]]:
    verdict = result.chosen.verdict if result.chosen is not None else None
    rows = [] if verdict is None else [("proved", words) for words in verdict.proofs]
    rows += rigour(result)
    if verdict is not None and not verdict.accepted:
        rows += [("not proved", words) for words in verdict.refusals]
    return rows


def _costs(result: DynamicResult) -> list[tuple[str, str]]:
    rows = []
    if np.isfinite(result.cost):
        exact = " (exact up to rounding)" if is_exact(result.certificate) else ""
        rows.append(("certified expected cost", f"at most {at_most(result.cost)}{exact}"))
    if np.isfinite(result.worst):
        certificate = result.certificate
        where = f", from x0 = {np.round(certificate.worst_start, 4).tolist()}" if isinstance(
            certificate, DynamicCertificate) else ""
        rows.append(("certified worst cost over the set", f"at most {at_most(result.worst)}{where}"))
    return rows + simulated(result.estimate)
