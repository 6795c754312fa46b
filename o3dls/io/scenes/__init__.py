"""Transforms with fields of displacements, and scenes, as ITK and 3D Slicer hold them.

Start with `displacements`.
"""
