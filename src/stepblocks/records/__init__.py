"""What is known of one made or measured thing, as typed documents and files."""
