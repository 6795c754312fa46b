"""The side-by-side report: one offline HTML file of a finished run, or of several runs of one case."""

from __future__ import annotations

from .writer import Report, write_report

__all__ = ["Report", "write_report"]
