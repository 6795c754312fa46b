"""An estimate as a file for other programs: what is written, where, and in which format."""
