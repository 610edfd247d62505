"""The path of a tip over a surface, and where the tip catches.

Profiles and height maps are dilated exactly.
"""
