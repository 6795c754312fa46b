"""The errors of a moved wall in space: their posterior at nodes of the wall, what a run folder keeps of it,
and samples of a surface.
"""
