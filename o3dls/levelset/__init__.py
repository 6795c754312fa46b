"""The level set phi on a narrow band: signed distances, operators, corrections along the normals, and the
reconstruction from dense maps.

May import motion, noise, geometry and what is below them. Start with `refine` (ours), `reconstruction` or
`paper` (equations 8-16 of the paper); `grid` holds the discretisation.
"""
