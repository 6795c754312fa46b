"""Files in and out: every reader states frame and units, every error names file and line.

May import case, estimate and geometry. Start with `case_reader`; `surfaces` chooses among the formats of
`meshes`, the label volumes of `images` and the MATLAB files of `matlab`; `mapping` holds the exports of
mapping systems.
"""
