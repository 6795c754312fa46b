"""What changed between two maps of one heart: values on the wall, and the shape of the wall."""
