"""Characteristics of a working edge.

They are height, edge radius, burr, riser, form and roughness of its faces, and the energy.
"""
