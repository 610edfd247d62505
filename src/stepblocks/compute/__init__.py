"""Heavy work: here, or in processes of this machine."""
