"""The side-by-side report: one offline HTML file of a finished run, of several runs of one case, or of a
cohort.

May import runs, evaluation and what is below them. Start with `writer`, then `page`; `sections` hold what is
said, `drawing` what is shown, `static` what runs in the browser.
"""
