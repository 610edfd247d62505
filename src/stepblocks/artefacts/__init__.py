"""Files: each writer beside its independent reader."""
