"""Files in and out: every reader states frame and units, every error names file and line.

May import case, estimate and geometry. Start with `case_reader`; `meshes` holds surface formats, `images`
label volumes, `mapping` the exports of mapping systems.
"""
