"""Local activation times over a wall, and how fast and which way the wave goes, each with its uncertainty."""
