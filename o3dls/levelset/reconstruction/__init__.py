"""The level set reconstructed from the points, with the moved prior as its mean where they say little.

Where the wall lies farther from the moved prior than a correction along its normals can follow: another
branch, another rhythm, another vein. May import levelset.grid, noise, geometry and what is below them. Start
with `reconstruct`.
"""
