"""Pictures of the report: surfaces, charts, outlines, and the data of the 3D viewer."""
