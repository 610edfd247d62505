"""The shape of each stimulus. Millimetres live here and in the writers; everything else is in metres."""
