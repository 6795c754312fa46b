"""A live session: a case grows point by point, each written down before it counts; the surface follows."""
