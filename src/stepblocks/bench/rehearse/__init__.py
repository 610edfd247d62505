"""Sessions of known truth: any effect planted, as a rig would have written them."""
