"""The points of a reconstruction: which touch the wall, which side of them is outside, where any lack."""
