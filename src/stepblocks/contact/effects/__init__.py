"""Effects that equations (1) and (2) lack: the laws of one slot in one file, each law one entry."""
