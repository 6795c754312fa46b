"""Finished runs: their scores and folder, their tables, and what is made of them for other programs.

May import plugins, evaluation and what is below them. Start with `run`.
"""
