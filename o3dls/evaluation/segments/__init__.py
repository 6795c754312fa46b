"""Division of the left atrium: its openings found and named, the segments of the wall, atrial coordinates."""
