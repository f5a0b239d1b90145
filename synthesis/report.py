"""The table that a control engineer reads."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from inc_casadi.comparison.statements import clauses
from inc_casadi.estimate import Estimate
from inc_casadi.figures import at_least, at_most
from inc_casadi.linear import UnswitchedCost
from inc_casadi.regional_certificate import RegionalCertificate

from .comparison import THIS
from .progress import counted
from .result import CERTIFIED, Result

if TYPE_CHECKING:
    from .dynamic_result import DynamicResult

WIDTH = 43


def table(result: Result) -> str:
    """Return the result as lines of "what  figure": status, proofs, costs, bounds, the sentence that follows, times."""
    rows: list[tuple[str, str]] = [("status", result.status.upper() if result.status == CERTIFIED else result.status)]
    if result.chosen is not None and result.inc is not None:
        rows.append(("controller", f"{result.chosen.name}: {counted(result.inc.q, 'hidden unit')}"))
    verdict = result.chosen.verdict if result.chosen is not None else None
    if verdict is not None:
        rows += [("proved", words) for words in verdict.proofs]
        rows += rigour(result)
        if not verdict.accepted:
            rows += [("not proved", words) for words in verdict.refusals]
    rows += _costs(result) + _bounds(result)
    rows += [("search", words) for words in _search(result)]
    rows += [("note", note) for note in result.notes]
    return written(rows, result)


def written(rows: list[tuple[str, str]], result: Result | DynamicResult) -> str:
    """Return the rows, the times and the sentence as lines."""
    rows = [*rows, ("time", ", ".join(f"{name} {value:.1f} s" for name, value in result.seconds.items()))]
    lines = [f"{name:<{WIDTH}} {value}" for name, value in _without_repeats(rows)]
    sentence = verdict_sentence(result)
    return "\n".join(lines + ([sentence] if sentence else []))


def verdict_sentence(result: Result | DynamicResult) -> str:
    """Return the theorem-like sentence that certified cost and lower bounds give together, or nothing."""
    if result.status != CERTIFIED:
        return ""
    found = clauses(result.comparison(), THIS, THIS)
    return (("Proved: " if result.proof else "In floating point: ") + "; ".join(found) + ".") if found else ""


def _search(result: Result) -> list[str]:
    """How the search went, and what the taken law came from."""
    chosen, words = result.chosen, [result.ended] if result.ended else []
    if chosen is not None and chosen.of:
        words.append(f"{chosen.name} follows from {chosen.of}: {chosen.why}")
    if chosen is not None and not np.isnan(chosen.before):
        words.append(chosen.note)
    return words


def rigour(result: Result | DynamicResult) -> list[tuple[str, str]]:
    """Return how the certificate was settled, in rows of the table."""
    if result.proof is None:
        return []
    if result.proof:
        return [("proved", f"all of it settled rigorously: {result.proof.method}")]
    return [("checked in floating point only", result.proof.reason)]


def _costs(result: Result) -> list[tuple[str, str]]:
    rows = []
    if np.isfinite(result.cost):
        rows.append(("certified expected cost", _exact(result)))
    if np.isfinite(result.worst):
        where = ""
        if isinstance(result.certificate, RegionalCertificate | UnswitchedCost):
            where = f", from x0 = {np.round(result.certificate.worst[1], 4).tolist()}"
        rows.append(("certified worst cost over the set", f"at most {at_most(result.worst)}{where}"))
    return rows + simulated(result.estimate)


def simulated(run: Estimate | None) -> list[tuple[str, str]]:
    """Return what a simulation came to, in rows of the table."""
    if run is None:
        return []
    words = (f"{run.mean:.4f} +- {run.standard_error:.4f} (standard error, {run.samples} samples)"
             if np.isfinite(run.mean) else f"diverges within {run.steps} steps")
    if np.isfinite(run.mean) and not run.settled:
        words += "; the motions do not come to rest"
    return [("simulated expected cost", words)]


def _exact(result: Result) -> str:
    words = f"at most {at_most(result.cost)}"
    if isinstance(result.certificate, RegionalCertificate) and np.isfinite(result.certificate.expected):
        words += f" (exact up to rounding: {result.certificate.expected:.8f})"
    if isinstance(result.certificate, UnswitchedCost) and result.certificate.gap == 0:
        words += f" (exact up to rounding: {result.certificate.cost:.8f})"
    return words


def lower(result: Result | DynamicResult) -> list[tuple[str, str]]:
    """Return the lower bounds, recomputed, in rows of the table."""
    return [(f"lower bound, {name}", at_least(float(bound)) + ("" if bound.holds() else " (not confirmed)"))
            for name, bound in result.bounds.items()]


def _bounds(result: Result) -> list[tuple[str, str]]:
    found = [(f"{name} (found)", f"{value:.6f}") for name, value in result.linear.items() if np.isfinite(value)]
    return lower(result) + found


def _without_repeats(rows: list[tuple[str, str]]) -> list[tuple[str, str]]:
    out: list[tuple[str, str]] = []
    last = ""
    for name, value in rows:
        out.append(("" if name == last else name, value))
        last = name
    return out
