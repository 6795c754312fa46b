"""The experiments of the paper and the questions that it left open: computed, kept as numbers, and shown on one page."""

from .compute import make, shown

__all__ = ["make", "shown"]
