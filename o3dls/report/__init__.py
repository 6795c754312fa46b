"""The side-by-side report: one offline HTML file of a finished run, of several runs of one case, or of a
cohort.
"""
