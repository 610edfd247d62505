"""What changed is made, checked and shown."""
