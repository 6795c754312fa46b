"""The shape of a reconstructed wall: which parts and handles it has."""
