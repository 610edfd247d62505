"""Programs in which other laboratories run their trials: what they read, what they write."""
