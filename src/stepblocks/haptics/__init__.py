"""For the simulator: meshes, convex pieces and height fields, each with its unit said beside it."""
