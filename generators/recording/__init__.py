"""The sound and the pictures of an observation, on their way into files."""
