"""The table of a controller with memory."""

from __future__ import annotations

import numpy as np

from inc_casadi.comparison.statements import clauses
from inc_casadi.dynamic import DynamicCertificate
from inc_casadi.figures import at_least, at_most

from .comparison import THIS
from .dynamic_result import DynamicResult, is_exact
from .progress import counted
from .report import WIDTH
from .result import CERTIFIED


def table(result: DynamicResult) -> str:
    """Return the result as lines of "what  figure": status, proofs, costs, bounds, times, and the sentence that follows."""
    rows: list[tuple[str, str]] = [("status", result.status.upper() if result.status == CERTIFIED else result.status)]
    if result.chosen is not None and result.dynamic is not None:
        size = f"{counted(result.dynamic.order, 'state')} of its own, {counted(result.dynamic.q, 'hidden unit')}"
        rows.append(("controller", f"{result.chosen.name}: {size}"))
    rows += _proofs(result) + _costs(result)
    rows += [(f"lower bound, {name}", at_least(float(bound)) + ("" if bound.holds() else " (not confirmed)"))
             for name, bound in result.bounds.items()]
    rows += [("search", result.ended)] if result.ended else []
    rows += [("note", note) for note in result.notes]
    rows.append(("time", ", ".join(f"{name} {value:.1f} s" for name, value in result.seconds.items())))
    names = [name for name, _ in rows]
    lines = [f"{'' if i and names[i - 1] == name else name:<{WIDTH}} {value}" for i, (name, value) in enumerate(rows)]
    sentence = verdict_sentence(result)
    return "\n".join(lines + ([sentence] if sentence else []))


def verdict_sentence(result: DynamicResult) -> str:
    """Return the theorem-like sentence that certified cost and lower bounds give together, or nothing."""
    if result.status != CERTIFIED:
        return ""
    found = clauses(result.comparison(), THIS, THIS)
    return (("Proved: " if result.proof else "In floating point: ") + "; ".join(found) + ".") if found else ""


def _proofs(result: DynamicResult) -> list[tuple[str, str]]:
    verdict = result.chosen.verdict if result.chosen is not None else None
    rows = [] if verdict is None else [("proved", words) for words in verdict.proofs]
    if result.proof is not None:
        rows += [("proved", f"all of it settled rigorously: {result.proof.method}")] if result.proof else [
            ("checked in floating point only", result.proof.reason)]
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
    run = result.estimate
    if run is not None:
        words = (f"{run.mean:.4f} +- {run.standard_error:.4f} (standard error, {run.samples} samples)"
                 if np.isfinite(run.mean) else f"diverges within {run.steps} steps")
        resting = "" if run.settled or not np.isfinite(run.mean) else "; the motions do not come to rest"
        rows.append(("simulated expected cost", words + resting))
    return rows
