"""The path of a tip over a surface.

Exact dilation of profiles and height maps, and where the tip catches.
"""
