"""From recorded answers to findings and the report."""
