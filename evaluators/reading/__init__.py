"""Opening and checking a submission."""
