"""The apparatus as a kit: what is declared of it, its components, its loads and its flexure."""
