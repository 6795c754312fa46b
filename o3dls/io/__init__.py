"""Files in and out: every reader states frame and units, every error names file and line."""
