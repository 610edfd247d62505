"""Who feels it: the experiments on people, from the design to the report."""
