"""Figures and the pages people read; sees results, not internals."""
