"""Why they differ: residuals traced to effects that a model lacks. Knows any forward model, no teeth and no steel."""
