"""Effects that equations (1) and (2) lack, each a `Law`."""
