"""Sheaths for the shank of a probe."""
