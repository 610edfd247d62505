"""A set designed by what is felt: from wanted energies to the sizes of its blocks."""
