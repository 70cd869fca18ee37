"""Ranges of what one may choose for a run, for the manifest, the command line and Python alike; imports nothing."""

#: Least and greatest number of frames of an observation: names of frames have three digits.
FRAMES = (1, 999)
#: Least and greatest side of a picture (pixels).
SIZE = (16, 8192)
#: Least and greatest number of processes.
WORKERS = (1, 256)
