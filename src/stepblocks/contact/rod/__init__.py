"""The probe as a clamped rod with a mass at its tip, what a sheath does to its ring, and the test that measures it."""
