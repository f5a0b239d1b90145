"""In and out: nouns, claims and certificates as JSON files."""

from .files import load, save

__all__ = ["load", "save"]
