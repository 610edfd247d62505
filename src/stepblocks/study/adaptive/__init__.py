"""Adaptive comparisons: the next block follows from the answers so far."""
