"""The file formats of CARTO 3: the .mesh files that it exports, and the VTK dialect that it imports."""
