"""The experiments as lists of trials, their orders, codes and sheets."""
