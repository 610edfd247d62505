"""What is made: one folder per kind, with its declaration, shape, characteristics and volume in closed form."""
