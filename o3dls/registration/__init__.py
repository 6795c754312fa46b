"""The pose: iterative closest points in the variants of the literature, landmarks, and a search of all poses.

Arrays in, arrays out; numpy, scipy and numba only. May import noise, geometry and what is below them; it
knows neither motion nor level set. Start with `icp`.
"""
