"""What speaks to Open3D, pymeshlab and trimesh: meshing, ICP steps, objects of other libraries.

May import case, estimate, io and the numerical packages. Start with `meshing`, or with `objects` for what
others hold.
"""
