"""The ring as files: sound, MPEG haptics and AHAP, with the rules that they must keep."""
