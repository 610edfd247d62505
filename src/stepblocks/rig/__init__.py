"""What a bench would record: the forward model of a session, and effects of contact and gauges."""
