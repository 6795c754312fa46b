"""The wall reconstructed from the points, with the moved prior as its mean where they say little.

It reaches what no motion can follow: another branch, another rhythm, another vein. May import levelset,
motion, noise, geometry and what is below them. Start with `reconstructed`, then `reconstruct`; `field`,
`points` and `shape` are its rooms, each of which may import those named before it.
"""
