"""The types of what the public verbs return and take apart, to be named in annotations and to ask `isinstance` of.

Nobody has to construct one: `certify`, `regions`, `largest_scale` and so on do. They are gathered here, so that no name of a
module within a package is needed. The nouns that one does construct are in `inc_casadi` itself.

>>> from inc_casadi import INC, Plant, equilibrium
>>> from inc_casadi.types import Equilibrium
>>> isinstance(equilibrium(Plant([[0.5]], [[1.0]]), INC.linear([[0.1]])), Equilibrium)
True
"""

from .admissible_set import AdmissibleSet
from .bounds.affine_bound import AffineMovesBound
from .bounds.any_controller import AnyControllerBound
from .bounds.static_output_feedback import StaticGainBound
from .certificate import MatrixCertificate, Proof
from .claims.invariance import Rows
from .comparison.comparison import Inversion
from .comparison.families import Family
from .comparison.floors import Floor
from .comparison.row import Cost, Row
from .comparison.statements import Statement
from .ellipsoid_certificate import EllipsoidCertificate
from .ellipsoidal_region import EllipsoidalRegion
from .estimate import Estimate
from .fixed_point import FixedPoint
from .inc import Adjoint
from .invariance_certificate import InvarianceCertificate
from .linear.clipping_walk import Clipping
from .linear.piece_loop import PieceLoop
from .loop import ClosedLoop, Equilibrium
from .mpc import Condensed
from .output_bounds.relaxation import Majorant
from .pieces.basin import Basin
from .pieces.cell_walk import CellWalk
from .pieces.difference import Difference
from .pieces.laws import Laws
from .pieces.reach import ReachableSets
from .pieces.regions import Regions
from .pieces.scale import Scale
from .regional_certificate import RegionalCertificate
from .sampled import SampledProblem
from .simulate import Trajectory
from .well_posed import WellPosedness

__all__ = [
    "Adjoint", "AdmissibleSet", "AffineMovesBound", "AnyControllerBound", "Basin", "CellWalk", "Clipping", "ClosedLoop",
    "Condensed", "Cost", "Difference", "EllipsoidCertificate", "EllipsoidalRegion", "Equilibrium", "Estimate", "Family",
    "FixedPoint", "Floor", "InvarianceCertificate", "Inversion", "Laws", "Majorant", "MatrixCertificate", "PieceLoop",
    "Proof", "ReachableSets", "RegionalCertificate", "Regions", "Row", "Rows", "SampledProblem", "Scale", "Statement",
    "StaticGainBound", "Trajectory", "WellPosedness",
]
