"""Regions of the wall, and where to map next, in the words of the report: `wall_regions`, then `advice`."""
