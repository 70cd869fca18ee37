"""The home of an observation: built and lit once and then cached, or read from a scan."""
