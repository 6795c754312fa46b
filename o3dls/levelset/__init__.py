"""The level set phi on a narrow band: signed distances, operators, and corrections along the normals.

May import motion, noise, geometry and what is below them. Start with `refine` (ours) or `paper` (equations
8-16 of the paper); `grid` holds the discretisation.
"""
