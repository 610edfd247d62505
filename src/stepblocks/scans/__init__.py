"""Scans of instruments: profiles and height maps, in metres, with what is known of their scale."""
