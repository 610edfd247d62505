"""What is asked for: blocks, margins and tips, their tolerances, and the files that declare them."""
