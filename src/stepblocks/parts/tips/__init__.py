"""Probe tips: a ball on a cone and a shank, straight or bent to a hook."""
