"""Scores of answers to the questions of `avs3d export qa`, and the task for language models."""
