"""Any continuous piecewise-affine law as an exact implicit controller (prop:pwa_relu)."""

from .represent import Representation, represent

__all__ = ["Representation", "represent"]
