"""Characteristics of a working edge.

Height, edge radius, burr, riser, form and roughness of its faces, and the energy.
"""
