"""Protocols: from the figures of frames to the scores of observations and their means."""
