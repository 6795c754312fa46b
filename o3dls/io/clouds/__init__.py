"""Clouds of points in the formats of meshes and of scanners: each is a table with the columns x, y and z."""
