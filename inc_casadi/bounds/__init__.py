"""Lower bounds on the cost of classes of controllers, each with the numbers that prove it."""

from ..reachability import uncontrollable_vertex
from .affine_moves import affine_moves
from .any_controller import any_controller
from .bound import Bound
from .first_move import first_move
from .output_feedback import any_output_feedback
from .scalar import ScalarSeparation
from .static_output_feedback import static_output_feedback

__all__ = ["Bound", "ScalarSeparation", "affine_moves", "any_controller", "any_output_feedback", "first_move",
           "static_output_feedback", "uncontrollable_vertex"]
