"""Pipelines: stages folded over a case, from Python or a TOML file, over one case or many.

May import stages, runs and what is below them. Start with `pipeline`.
"""
