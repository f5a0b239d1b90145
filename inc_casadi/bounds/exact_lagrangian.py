"""Weak duality for moves that are affine in the initial state, in exact rational arithmetic from the stored floats."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..blocks import exact
from ..sets import Box, Polytope
from ..spec import Spec
from .affine_problem import extended
from .exact_anchors import on_anchors
from .exact_moments import extended_moment, is_semidefinite
from .exact_polytope import corners
from .lagrangian import Lagrangian
from .moves import rollout
from .tied import tying_forces


def exact_lower(problem: Lagrangian) -> Fraction | str:
    """Return a number that no admissible affine moves undercut, in Fractions, or why there is none.

    With M = E [x_0; 1][x_0; 1]' (`extended_moment`) and x_k = X_k [x_0; 1] the cost is
    sum_k beta^k tr(Q X_k M X_k' + R U_k M U_k'), the last state included. For Q, R, M >= 0, which is checked, and any trial
    Y_k, here the stored moves and a rounded trajectory,

        tr(Q X M X') >= 2 tr(Q Y M X') - tr(Q Y M Y'),

    and p_N = 2 beta^N Q Y_N M, p_k = A'p_{k+1} + 2 beta^k Q Y_k M turn the sum over k into <p_0, X_0> and terms
    <G_k, U_k>, G_k = B'p_{k+1} + 2 beta^k R V_k M. Multipliers >= 0 times cuts at states that occur add to G_k, and so do
    ties (`tying_forces`) with the exact hidden states, which gives M_k. The moves are [Y_k, d_k] E_k with E_k from the
    exact rows of C, ..., CA^k; N_k with M_k E_k' = N_k (E_k [V; 1])' at anchors V that occur is the float solution,
    repaired exactly at r + 1 anchors; and
    <M_k, U_k> >= -sum_i max over the limits of -N_k,i'u, on a polytope by all its vertices.
    """
    inputs = problem.spec.inputs
    assert inputs is not None
    trouble = problem.trouble or indefinite(problem.spec)
    if trouble:
        return trouble
    M, vertices = extended_moment(problem.spec.initial), _vertices(inputs)
    if isinstance(M, str):
        return M
    if isinstance(vertices, str):
        return vertices
    value, forces = _tangent(problem, M)
    h, multipliers = exact(inputs.h), exact(problem.multipliers)
    value -= (multipliers * h[problem.cuts.facet]).sum() if multipliers.size else 0
    forces = [force + _of_cuts(problem, k) for k, force in enumerate(forces)]
    if problem.ties is not None:
        tied = tying_forces(exact(problem.ties), problem.hidden, exact(problem.plant.A))
        forces = [force + _widened(tie) for force, tie in zip(forces, tied, strict=True)]
    for N in on_anchors(problem.plant, problem.anchors, forces):
        if N is None:
            return "the anchors do not span the initial states"
        value -= np.sum(_support(inputs, vertices, -N))
    return Fraction(value)


def indefinite(spec: Spec) -> str:
    """Return in words which weight is not positive semidefinite exactly, or nothing.

    >>> from inc_casadi import Box
    >>> indefinite(Spec(Q=1.0, R=0.0, discount=1.0, initial=Box(-1, 1)))
    ''
    """
    for name, weight in (("Q", spec.Q), ("R", spec.R)):
        if not is_semidefinite(exact(weight)):
            return f"{name} has a negative eigenvalue, if only by rounding: add a little to its diagonal"
    return ""


def _tangent(problem: Lagrangian, M: np.ndarray) -> tuple[Fraction, list[np.ndarray]]:
    # The constant <p_0, X_0> - offset and the slopes G_k.
    plant, spec, V = problem.plant, problem.spec, exact(problem.moves)
    n, N, beta = plant.n, len(V), Fraction(spec.discount)
    A, B, Q, R = (exact(each) for each in (plant.A, plant.B, spec.Q, spec.R))
    Y = exact(rollout(plant.A, plant.B, np.eye(n, n + 1), problem.moves))
    p, offset, slopes = np.full((n, n + 1), Fraction(0), dtype=object), Fraction(0), []
    for k in range(N, -1, -1):
        if k < N:
            weighed = beta**k * (R @ (V[k] @ M))
            slopes.append(B.T @ p + 2 * weighed)
            offset += np.sum(weighed * V[k])
        weighed = beta**k * (Q @ (Y[k] @ M))
        p = A.T @ p + 2 * weighed
        offset += np.sum(weighed * Y[k])
    return np.trace(p[:, :n]) - offset, slopes[::-1]


def _of_cuts(problem: Lagrangian, k: int) -> np.ndarray:
    # sum over the cuts of move k of their multiplier times H[facet]'[point; 1]'.
    assert problem.spec.inputs is not None
    mine = np.flatnonzero((problem.cuts.move == k) & (problem.multipliers > 0))
    weighed = exact(problem.multipliers[mine])[:, None] * exact(problem.spec.inputs.H)[problem.cuts.facet[mine]]
    columns = exact(extended(problem.cuts.point[:, mine]))
    return weighed.T @ columns.T if mine.size else np.full(problem.moves.shape[1:], Fraction(0), dtype=object)


def _widened(force: np.ndarray) -> np.ndarray:
    return np.hstack([force, np.full((len(force), 1), Fraction(0), dtype=object)])


def _vertices(inputs: Box | Polytope) -> np.ndarray | str:
    # All vertices (V, m) of a polytope of inputs; of a box none are needed.
    if isinstance(inputs, Box):
        return np.empty((0, inputs.dimension), dtype=object)
    found = corners(inputs)
    return found if isinstance(found, str) else found.points


def _support(inputs: Box | Polytope, vertices: np.ndarray, directions: np.ndarray) -> np.ndarray:
    if isinstance(inputs, Box):
        ends = (exact(end)[:, None] * directions for end in (inputs.lower, inputs.upper))
        return np.sum(np.maximum(*ends), axis=0)
    return np.max(vertices @ directions, axis=0)
