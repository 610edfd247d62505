"""Parts: one file per kind, with declaration, shape, characteristics and volume."""
