"""The path of a tip over a surface: exact dilation of profiles and height maps, and where the tip catches."""
