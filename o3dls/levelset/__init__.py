"""The level set phi on a narrow band: signed distances, operators, repairs of surfaces that run into
themselves, and the paper's descent.

May import geometry and what is below it. Start with `repair` (the level set of a moved prior) or `paper`
(equations 8-16 of the paper); `grid` holds the discretisation, `result` what all of them return.
"""
