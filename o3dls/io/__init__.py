"""Files in and out: every reader states frame and units, every error names file and line."""

from .case_folder import read_case, write_case
from .mesh import read_surface, read_surface_file, write_surface
from .points import read_points, write_points

__all__ = ["read_case", "read_points", "read_surface", "read_surface_file", "write_case", "write_points", "write_surface"]
