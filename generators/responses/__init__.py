"""Dense impulse responses of the rooms of a dataset or a manifest: `avs3d export acoustics`."""
