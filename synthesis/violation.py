"""The violation nu of a matrix inequality at given numbers, with its derivative in the controller, and as a penalty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from inc_casadi.arrays import Array, number
from inc_casadi.brief import Brief
from inc_casadi.claims.base import Claim
from inc_casadi.errors import DimensionError
from inc_casadi.inc import INC
from inc_casadi.multipliers import Multiplier, as_multiplier
from inc_casadi.plant import as_plant

from .certified_cost import Gradient
from .condition_graph import ConditionGraph, condition_graph
from .law_family import flat, unflat
from .objective import Layout, Objective

SAME = 1e-8  # eigenvalues closer than this, relative to the largest magnitude, count as one


@dataclass(frozen=True, eq=False)
class Violation(Brief):
    """nu, negative where the inequality holds strictly; its gradient; the condition it is of; how often nu occurs in it."""

    value: float
    gradient: Gradient
    condition: str
    multiplicity: int


def violation(plant: Any, inc: INC, claim: Claim, multiplier: str | Multiplier, values: Mapping[str, Array]) -> Violation:
    """Return nu(theta; P, multipliers), the largest eigenvalue of the inequality's left side (eq:stab_violation).

    nu = max_k lambda_max(-L_k(theta; values)) over the conditions L_k > 0 that depend on the controller: for `Stability` and
    `DiscountedCost` under a multiplier without lifting the one of eq:stab_violation or eq:perf_violation. With v a unit
    eigenvector, d nu = -v'(dL_k)v = <v v', -dL_k>. Where the eigenvalue occurs r times, V its eigenvectors, nu is not
    differentiable in general; V V' / r is used for v v', which gives an element of Clarke's generalized gradient. Of several
    conditions that attain the maximum the first is taken.

    values: the certificate's numbers, as `MatrixCertificate.values` (they need not prove anything).
    Raises InvalidInputError for a claim that is not differentiated, DimensionError when a value is missing.

    >>> import numpy as np
    >>> from inc_casadi import Plant, Stability
    >>> law = INC([[0.0]], [[1.0]], [[0.2]], [[0.0]])
    >>> nu = violation(Plant([[0.5]], [[1.0]]), law, Stability(0.9), "sector", {"P": [[1.0]], "Lambda": [0.5]})
    >>> nu.value < 0, nu.condition
    (True, 'decrease')
    """
    graph = condition_graph(as_plant(plant), inc, claim, as_multiplier(multiplier))
    missing = set(graph.unknowns) - set(values)
    if missing:
        raise DimensionError(f"values lacks {', '.join(sorted(missing))}")
    value, slope, name, count = violation_at(graph, inc, {key: np.asarray(value) for key, value in values.items()})
    return Violation(value, Gradient(*unflat(slope, inc)), name, count)


def violation_at(graph: ConditionGraph, inc: INC, values: Mapping[str, Array]) -> tuple[float, Array, str, int]:
    """Return nu, its gradient (P,), the condition and the multiplicity, for a law of the graph's kind."""
    L = graph.at(inc, values)
    spectra = {name: np.linalg.eigh(-L[name]) for name in graph.moving}
    name = max(spectra, key=lambda key: float(spectra[key][0][-1]))
    eigenvalues, vectors = spectra[name]
    top = vectors[:, eigenvalues >= eigenvalues[-1] - SAME * np.max(np.abs(eigenvalues))]
    count = top.shape[1]
    return float(eigenvalues[-1]), -graph.slope(inc, values, {name: top @ top.T / count}), name, count


class Penalized:
    """The objective of training with the violation on top (eq:cert_aware_loss): J + rho max(0, nu + margin)^2.

    Squared, so that it is differentiable where the inequality begins to hold. Answers to all that `nlp.minimize` asks of an
    `Objective`, whose logarithm and scale it keeps; the penalty's Hessian is that of Gauss and Newton.

    objective: of a training; graph, values: the inequality at fixed numbers; rho > 0 in units of cost per squared nu.
    """

    def __init__(self, objective: Objective, graph: ConditionGraph, values: Mapping[str, Array], rho: float,
                 margin: float = 0.0) -> None:
        self.objective, self.graph, self.values_of = objective, graph, dict(values)
        self.rho, self.margin = number("rho", rho, 0.0), number("margin", margin)
        self.layout: Layout = objective.layout
        self.scale = objective.scale

    def value(self, x: Array) -> float:
        """Return log(1 + (J + penalty) / scale), NaN where the loop is lost."""
        excess, _ = self._excess(x)
        return float(np.log(np.exp(self.objective.value(x)) + self.rho * excess**2 / self.scale))

    def gradient(self, x: Array) -> Array:
        """Return the gradient of `value` (nx,)."""
        excess, slope = self._excess(x)
        plain = np.exp(self.objective.value(x))
        total = plain + self.rho * excess**2 / self.scale
        return (plain * self.objective.gradient(x) + 2.0 * self.rho * excess / self.scale * slope) / total

    def hessian(self, x: Array) -> Array:
        """Return the damped Gauss-Newton Hessian of `value` (nx, nx)."""
        excess, slope = self._excess(x)
        plain = np.exp(self.objective.value(x))
        total = plain + self.rho * excess**2 / self.scale
        active = 2.0 * self.rho / self.scale * (excess > 0.0)
        return (plain * self.objective.hessian(x) + active * np.outer(slope, slope)) / total

    def _excess(self, x: Array) -> tuple[float, Array]:
        """Return max(0, nu + margin) and its gradient in x; biases do not enter."""
        law = self.layout.parameters(x)
        inc = INC(law.W, law.U, law.V, law.K, activation=self.graph.inequalities.loop.inc.activation)
        nu, slope, _, _ = violation_at(self.graph, inc, self.values_of)
        if nu + self.margin <= 0.0:
            return 0.0, np.zeros(x.size)
        theta = np.concatenate([slope, np.zeros(self.layout.fixed.size - flat(inc).size)])
        return nu + self.margin, theta[self.layout.index] * self.layout.factor
