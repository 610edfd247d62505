"""The window: a page for each task of a user, on one folder; it computes nothing.

Every button runs a command and shows it, with the lines of Python that do the same.
"""
