"""The experiments of the paper and the questions that it left open: computed, kept as numbers, and shown on
one page.
"""
