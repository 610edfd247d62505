"""STEP AP242 with tolerances: written through the kernel, read back as text."""
