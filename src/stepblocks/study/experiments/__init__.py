"""The kinds of experiment, one file each: what it asks, and how answers become findings."""
