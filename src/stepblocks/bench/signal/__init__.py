"""One trace: where things happen in it, and every figure that it gives."""
