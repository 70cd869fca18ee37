"""A source walks round a listener in a room: write what both ears hear.

python examples/moving_source.py moving.wav [--seconds 4]
"""

import argparse
import math

import numpy as np
import soundfile

from generators import acoustics

RATE = 44_100


def main() -> None:
    """Trace, render, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out")
    parser.add_argument("--seconds", type=float, default=4.0)
    given = parser.parse_args()

    room = acoustics.Room.shoebox((6, 2.7, 5), {"walls": "plaster", "floor": "carpet", "ceiling": "plaster"})
    listener = acoustics.Pose.from_yaw((3, 1.5, 2.5), yaw=0.0)  # looks along −Z
    # A quarter of a turn to the right, at 1.5 m: time and place, linear in between.
    path = []
    for k in range(20):
        angle = math.radians(-45 + 90 * k / 19)
        path.append((given.seconds * k / 19, (3 + 1.5 * math.sin(angle), 1.5, 2.5 - 1.5 * math.cos(angle))))

    noise = np.random.default_rng(0).standard_normal(round(given.seconds * RATE)) * 0.05
    heard = acoustics.Tracer(seed=1).render(room, noise, path, listener)  # (2, n) float32
    soundfile.write(given.out, heard.T, RATE)
    tenth = heard.shape[1] // 10
    for name, part in (("first", heard[:, :tenth]), ("last", heard[:, -tenth:])):
        left, right = np.square(part).sum(axis=1)
        print(f"{name} tenth: left ear {10 * math.log10(left / right):+.1f} dB above the right one")


if __name__ == "__main__":
    main()
