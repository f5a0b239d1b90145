"""What a file may hold: the dataclasses that are written field by field, and what is particular about some of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..activations import CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh, TwoSlopes
from ..admissible_set import AdmissibleSet
from ..affine_pieces import Representation
from ..arrays import matrix
from ..bounds.affine_bound import AffineMovesBound
from ..bounds.affine_problem import Cuts
from ..bounds.any_controller import AnyControllerBound
from ..bounds.cell_bounds import Trials
from ..bounds.cells import Cloud, Points
from ..bounds.gain_box import FirstBox
from ..bounds.grid_price import GridPrice
from ..bounds.halved_cells import Boxes, Simplices
from ..bounds.halvings import Halvings
from ..bounds.output_feedback import OutputFeedbackBound
from ..bounds.scalar import ScalarSeparation
from ..bounds.static_output_feedback import StaticGainBound
from ..bounds.unknown_part import Chord
from ..bounds.unmeasured import UnmeasuredBound
from ..bounds.value_iteration import UnlimitedBound
from ..certificate import MatrixCertificate, Proof
from ..claims import (
    Attraction,
    DeviationCost,
    DiscountedCost,
    Invariance,
    L2Gain,
    Margins,
    Polytopic,
    Regional,
    Robust,
    Stability,
    Together,
)
from ..comparison import Comparison
from ..comparison.controllers import CallableLaw
from ..comparison.families import Family, family_of
from ..comparison.floors import Floor
from ..comparison.row import Cost, Finding, Row
from ..dynamic import DynamicCertificate, DynamicINC, Folded
from ..ellipsoid_certificate import EllipsoidCertificate
from ..ellipsoidal_region import EllipsoidalRegion
from ..errors import InvalidInputError
from ..estimate import Estimate
from ..inc import INC
from ..invariance_certificate import InvarianceCertificate
from ..linear import ClippedCost, LinearController, LinearCost, StaticGain, UnswitchedCost
from ..linear.dynamic_loop import StartedFrom
from ..loop import Equilibrium
from ..mpc import MPC
from ..multipliers import Lifted, Relu, Sector, Slope
from ..pieces.conewise_tail import ConewiseProof
from ..pieces.critical_regions import CriticalRegions
from ..pieces.difference import Difference
from ..pieces.regions import Regions
from ..pieces.scale import Scale
from ..pieces.walk import Budget
from ..plant import Plant
from ..regional_certificate import RegionalCertificate
from ..sets import Box, Ellipsoid, Empirical, Gaussian, Moments, Polytope, Uniform
from ..simulate import Trajectory
from ..spec import Spec
from ..uncertainty import InputSector, NormBounded

KINDS: tuple[type, ...] = (
    Plant, INC, Spec, Box, Polytope, Ellipsoid, Uniform, Gaussian, Empirical, Moments, StartedFrom, Stability,
    DiscountedCost, DeviationCost, L2Gain, Margins, Robust, Polytopic, Together, Regional, Attraction, Invariance,
    InputSector, NormBounded, Sector, Slope, Relu, Lifted, MatrixCertificate, RegionalCertificate, EllipsoidCertificate,
    InvarianceCertificate, Budget, CenteredLogistic, Identity, LeakyReLU, Logistic, ReLU, Saturation, Tanh, TwoSlopes,
    ConewiseProof, Proof, Estimate, Trajectory, Equilibrium, LinearController, LinearCost, StaticGain, DynamicINC,
    DynamicCertificate, Folded, MPC, CriticalRegions, AffineMovesBound, Cuts, AnyControllerBound, Points, Cloud, Boxes,
    Simplices, Trials, UnlimitedBound, StaticGainBound, FirstBox, Halvings, ScalarSeparation, Comparison, Row, Finding,
    OutputFeedbackBound, GridPrice, UnmeasuredBound, Chord, Cost, Family, Floor,
    AdmissibleSet, Regions, Difference, Scale,
    Representation, EllipsoidalRegion, UnswitchedCost, ClippedCost,
)
"""The dataclasses that a file may hold, each written field by field under its class's name; add a class to save it."""

ADDED: dict[type, set[str]] = {RegionalCertificate: {"conewise"}}
"""Fields that files of this version were once written without: where they are missing, they have their default."""


def _family(**parts: Any) -> Family:
    # Classes of controllers are told apart by identity, so the known one is meant.
    family = family_of(parts["key"])
    if Family(**parts) != family:
        raise InvalidInputError(f"the class {parts['key']!r} is described in other words than this toolbox has for it")
    return family


def _comparison(**parts: Any) -> Comparison:
    from .agreement import disagreement
    made = Comparison(**parts)
    trouble = disagreement(made)
    if trouble:
        raise InvalidInputError(trouble)
    return made


def _polytope(H: Any, h: Any, vertices: Any = None) -> Polytope:
    # Of a hull of points the points are the truth to the last bit: what half-spaces say again is rounded, in another order.
    made = Polytope(H, h)
    if vertices is None:
        return made
    points = matrix("vertices", vertices, (made.dimension, None))
    reach = np.max(np.abs(points)) * np.abs(made.H).sum(axis=1) + np.abs(made.h)
    off = np.abs(np.max(made.H @ points, axis=1) - made.h)
    hull = Polytope.from_vertices(points)
    extreme = hull.vertices.shape == points.shape
    if not extreme or np.any(off > VERTEX_TOL * reach) or abs(hull.volume / Polytope(H, h).volume - 1) > VOLUME_TOL:
        raise InvalidInputError("vertices are not those of the half-spaces")
    made.__dict__["vertices"] = points
    return made


MAKERS: dict[type, Callable[..., Any]] = {Family: _family, Comparison: _comparison, Polytope: _polytope}
"""How kinds are made of their fields, where it is not by their constructor."""

BESIDE: dict[type, set[str]] = {Polytope: {"vertices"}}
"""What is written beside the fields where it is known, and handed to the maker."""

VERTEX_TOL, VOLUME_TOL = 1e-12, 1e-9  # relative roundings that the vertices of a polytope may show

STAND_INS: dict[type, Callable[[Any], str]] = {
    CallableLaw: lambda law: f"a function named {law.name!r}, which no file can hold",
}
"""What cannot be written, and the words that stand in its place."""
