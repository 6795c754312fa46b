"""The experiments of the paper and the questions that it left open: computed, kept as numbers, and shown on
one page.

May import everything but the command line, and the generators of synthetic cases (`data_synth`). Start with
`compute`.
"""
