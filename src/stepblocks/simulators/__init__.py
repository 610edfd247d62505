"""For the simulator: scenes, devices, rings, the renderer, and the page to feel."""
