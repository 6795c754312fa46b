"""How good an estimate is: distances, validity of its surface, values carried between points and surfaces.

May import adapters and what is below them. Start with `distances`.
"""
