"""TOML files to sets of parts, and which stimuli of them are meant."""
