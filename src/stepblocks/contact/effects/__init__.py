"""Effects that equations (1) and (2) lack: one law per file, each changing one slot of the model."""
