"""Trace residuals to effects that a model lacks.

The search takes any forward model; it knows neither teeth nor steel.
"""
