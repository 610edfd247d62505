"""Drawings of the parts: views, exaggerated details, dimensions with tolerances, as DXF, SVG and PDF."""
