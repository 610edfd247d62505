"""Experiments as lists of trials: designed, simulated, and written as sheets."""
