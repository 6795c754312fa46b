"""Stacks of slices through the image of the prior, with what the run found brought back onto it."""
