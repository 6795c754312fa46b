"""The page of a cohort: runs of many cases, paired within their cases, the worst first."""
