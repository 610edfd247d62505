"""From the answers that were written down to what they say."""
