"""What will be felt: sets, tables, sweeps; as declared, as built, as perceived."""
