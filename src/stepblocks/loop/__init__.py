"""What the model lacks: a session in; residual, effect, error before and after, out."""
