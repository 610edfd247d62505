"""What others published, beside what the model says: agrees, disagrees, or not said."""
