"""Dataset to submission."""
