"""Meshes, written by small writers and read back through other libraries."""
