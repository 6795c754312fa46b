"""The side-by-side report: one offline HTML file of a finished run, of several runs of one case, or of a cohort."""

from __future__ import annotations

from .writer import Report, compare, write_report

__all__ = ["Report", "compare", "write_report"]
