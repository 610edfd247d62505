"""A session before there is one: planned, simulated, and written as a laboratory brings it."""
