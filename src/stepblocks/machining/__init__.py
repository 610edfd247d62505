"""For the workshop: the files that a part is made from."""
