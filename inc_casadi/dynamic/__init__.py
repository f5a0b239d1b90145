"""Controllers with memory: an implicit controller with a state of its own, observers with an implicit readout."""

from .certificate import DynamicCertificate, certify_dynamic
from .controller import DynamicINC
from .extended import extended, extended_spec
from .fold import Folded, folded
from .observer import corrected, observer, observer_gain

__all__ = [
    "DynamicCertificate", "DynamicINC", "Folded", "certify_dynamic", "corrected", "extended", "extended_spec", "folded",
    "observer", "observer_gain",
]
