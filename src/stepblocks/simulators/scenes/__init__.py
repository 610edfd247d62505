"""One file per simulator: what each needs to load a stimulus and to render it as the formula says."""
