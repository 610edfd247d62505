"""Is it right: what was written and what was machined, read back and measured."""
