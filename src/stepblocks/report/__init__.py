"""Figures and the pages that people read."""
