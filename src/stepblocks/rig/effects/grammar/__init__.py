"""Laws composed of a slot, a covariate and a shape."""
