"""Figures and the pages people read."""
