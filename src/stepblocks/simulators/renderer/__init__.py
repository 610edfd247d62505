"""A reference renderer: position and velocity in, force out, for any device and any stimulus."""
