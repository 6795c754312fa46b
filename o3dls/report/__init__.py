"""The side-by-side report: one offline HTML file of a finished run, of several runs of one case, or of a
cohort.

May import runs, evaluation and what is below them. Start with `writer`, then `page`; `surfaces` are made
ready, `drawing` shows them, `sections` hold what is said, `static` what runs in the browser.
"""
