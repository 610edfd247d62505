"""A scan in, a verdict out."""
