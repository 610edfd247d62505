"""Haptic step stimuli: asked for, shaped, made, checked, predicted, felt and explained, in that order."""

__version__ = "0.1.0"
