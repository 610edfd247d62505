"""The experiments on people, from the design to the report."""
