"""The walk, the gaze, and sources that move."""
