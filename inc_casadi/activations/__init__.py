"""Activations, one file each: the function and the facts that are true of it everywhere."""

from .base import Activation, Pieces
from .centered_logistic import CenteredLogistic
from .identity import Identity
from .leaky_relu import LeakyReLU
from .logistic import Logistic
from .relu import ReLU
from .saturation import Saturation
from .tanh import Tanh
from .two_slopes import TwoSlopes

__all__ = [
    "Activation", "CenteredLogistic", "Identity", "LeakyReLU", "Logistic", "Pieces", "ReLU", "Saturation", "Tanh",
    "TwoSlopes",
]
