"""What the baselines that use other people's networks share: checkpoints, devices, pictures and clips as input."""
