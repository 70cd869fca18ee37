"""A dataset as files that a host of data takes (`avs3d release`), and back (`avs3d get`)."""
