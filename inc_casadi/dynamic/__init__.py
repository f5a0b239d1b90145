"""Controllers with memory: an implicit controller with a state of its own, observers with an implicit readout."""

from .certificate import DynamicCertificate, certify_dynamic
from .controller import DynamicINC
from .extended import extended, extended_spec
from .flat import FlatCertificate
from .fold import Folded, folded
from .observer import corrected, observer, observer_gain
from .scheduled import filter_gains, scheduled_observer

__all__ = [
    "DynamicCertificate", "DynamicINC", "FlatCertificate", "Folded", "certify_dynamic", "corrected", "extended",
    "extended_spec", "filter_gains", "folded", "observer", "observer_gain", "scheduled_observer",
]
