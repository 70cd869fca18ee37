"""Many responses of many rooms, streamed to WebDataset shards.

    python examples/many_responses.py rirs [--rooms 3] [--sources 2] [--listeners 4] [--processes 2]

The same arguments give the same bytes, in any number of processes.
"""

import argparse
from collections.abc import Iterator

import numpy as np

from generators import acoustics


def responses(rooms: int, sources: int, listeners: int, processes: int) -> Iterator[acoustics.Rir]:
    """Responses of shoeboxes that are drawn; a few are in memory at a time."""
    engine = acoustics.Tracer(seed=1)
    for number in range(rooms):
        rng = np.random.default_rng([1, number])
        size = rng.uniform((3, 2.4, 3), (8, 3.5, 6))
        walls = rng.choice(["plaster", "brick", "concrete", "wood"])
        room = acoustics.Room.shoebox(size, {"walls": walls, "floor": "parquet", "ceiling": rng.uniform(0.05, 0.5)})
        places = rng.uniform(0.5, size - 0.5, (sources + listeners, 3))
        yield from engine.responses(
            room, places[:sources], places[sources:], receiver=acoustics.Omni(), sample_rate=16_000, processes=processes
        )


def main() -> None:
    """Draw, trace, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out")
    for name, usual in (("rooms", 3), ("sources", 2), ("listeners", 4), ("processes", 1)):
        parser.add_argument(f"--{name}", type=int, default=usual)
    given = parser.parse_args()
    made = responses(given.rooms, given.sources, given.listeners, given.processes)
    for shard in acoustics.write_webdataset(made, given.out, per_shard=1000):
        print(shard)


if __name__ == "__main__":
    main()
