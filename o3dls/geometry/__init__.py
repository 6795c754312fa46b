"""Exact geometry of curves and surfaces: similarities, closest points, normals and curvature, components.

Arrays and `Surface` in, arrays out; 2D and 3D by one code. May import arrays, errors and parallel. Start with
`surface` and `closest_point`.
"""
