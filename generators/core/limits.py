"""Allowed ranges of a run's options, for the manifest, the command line and Python; imports nothing."""

#: Least and greatest number of frames of an observation; file names of frames have three digits.
FRAMES = (1, 999)
#: Least and greatest side of a picture (pixels).
SIZE = (16, 8192)
#: Least and greatest number of worker processes.
WORKERS = (1, 256)
#: An observation makes use of so many cores: four render frames, and the sound, which only one can compute, then takes
#: as long as they do (docs/scaling.md).
MOST_CORES = 5
