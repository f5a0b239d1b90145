"""Self-contained C for a law, with a proved error bound and a proved number of operations."""

from .generate import to_c
from .source import CSource

__all__ = ["CSource", "to_c"]
