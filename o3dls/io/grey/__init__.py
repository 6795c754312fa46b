"""The grey image of a prior, which stays where it is: opened, compared with the prior, read by slices."""
