"""What is heard and seen of an observation, on its way into files."""
