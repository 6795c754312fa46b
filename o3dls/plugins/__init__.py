"""The plugin interface: parameters that check themselves, stages found by entry point, and their help.

May import case, estimate and what is below them. Start with `stage`.
"""
