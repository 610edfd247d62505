"""The step block: one working edge, and beside it a groove or ridge of the same height to measure it by."""
