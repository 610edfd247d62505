"""Evaluations of profiles and maps: heights, radii, gaps, form, each with its uncertainty."""
