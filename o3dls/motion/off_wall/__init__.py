"""The motion off the wall: a field in space that agrees with it on the wall, its inverse, and both on grids.

Start with `field`.
"""
