"""The drag in time: a tip on a spring, pulled over a surface until it slips and rings."""
