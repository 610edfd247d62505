"""What others published, beside what the model says: agrees, disagrees, or not said.

``make evidence`` writes the page and the tables into ``out/evidence``.
"""
