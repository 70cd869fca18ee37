"""Shared by the baselines that use networks of others: checkpoints, devices, pictures and clips as input."""
