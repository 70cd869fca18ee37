"""The home of an observation, built and lit once and kept, or read from a scan."""
