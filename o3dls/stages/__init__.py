"""One file per stage of a pipeline: `(case, estimate) -> estimate`; wiring, and no mathematics.

May import plugins, evaluation, adapters and the numerical packages. Start with `deform`.
"""
