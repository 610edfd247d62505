"""Residuals traced to effects that a model lacks. Knows any forward model.

No teeth and no steel.
"""
