"""Reference predictions that every evaluation scores beside the submission."""
