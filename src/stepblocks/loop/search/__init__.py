"""Residuals traced to effects that a model lacks. Knows any forward model, no teeth and no steel."""
