"""Streams many impulse responses of a room to WebDataset shards, and measures rate, memory and bytes.

    python -m benchmarks.response_rate FOLDER [--responses 2000] [--processes 2] [--receiver omni] [--checked 20]

The responses are those of `Engine.responses` in that many processes: sources drawn in the room, 125 listeners for each.
Then a sample of them is read back from the shards and compared with single calls of `Engine.response`, each of which
traces for itself: the samples must be the same to the bit and the metadata the same. Exits with 1 if one differs.
"""

from __future__ import annotations

import argparse
import io
import json
import resource
import sys
import tarfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from generators import acoustics

F64 = NDArray[np.float64]

#: Listeners of each source; they share a trace.
LISTENERS = 125
#: The room (m), and how far from its walls sources and listeners stay.
SIZE, MARGIN = (7.0, 2.7, 5.0), 0.5
SAMPLE_RATE = 16_000
RECEIVERS = {"omni": acoustics.Omni, "head": acoustics.SphericalHead}


@dataclass(frozen=True, eq=False)
class Work:
    """What is to be made: ``sources`` (S, 3) and ``listeners`` (L, 3), metres."""

    engine: acoustics.Tracer
    room: acoustics.Room
    receiver: Any
    sources: F64
    listeners: F64

    @classmethod
    def drawn(cls, responses: int, receiver: str) -> Work:
        """The room with as many sources as ``responses`` need, rounded up to whole sources."""
        rng = np.random.default_rng(0)
        listeners = min(LISTENERS, responses)
        low, high = np.full(3, MARGIN), np.array(SIZE) - MARGIN
        sources = rng.uniform(low, high, (-(-responses // listeners), 3))
        room = acoustics.Room.shoebox(SIZE, {"floor": "parquet", "*": "plaster"})
        places = rng.uniform(low, high, (listeners, 3))
        return cls(acoustics.Tracer(seed=1), room, RECEIVERS[receiver](), sources, places)

    def all(self, processes: int) -> Iterator[acoustics.Rir]:
        """Every response, source by source."""
        return self.engine.responses(
            self.room,
            self.sources,
            self.listeners,
            receiver=self.receiver,
            sample_rate=SAMPLE_RATE,
            processes=processes,
        )

    def single(self, number: int) -> acoustics.Rir:
        """Response ``number`` by a call of its own."""
        source, listener = divmod(number, len(self.listeners))
        return self.engine.response(
            self.room, self.sources[source], self.listeners[listener], self.receiver, sample_rate=SAMPLE_RATE
        )


def read_back(shard: Path, number: int) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Samples (channels, n) and metadata of a response in a shard."""
    with tarfile.open(shard) as tar:

        def part(ending: str) -> bytes:
            stream = tar.extractfile(f"{number:08d}.{ending}")
            assert stream is not None
            return stream.read()

        samples: NDArray[np.float32] = np.load(io.BytesIO(part("npy")))
        return samples, json.loads(part("json"))


def differing(work: Work, shards: list[Path], per_shard: int, checked: int) -> list[int]:
    """Numbers of the responses, of ``checked`` drawn ones, that are not those of single calls."""
    count = len(work.sources) * len(work.listeners)
    numbers = np.random.default_rng(1).choice(count, min(checked, count), replace=False)
    wrong = []
    for number in sorted(int(each) for each in numbers):
        samples, metadata = read_back(shards[number // per_shard], number)
        single = work.single(number)
        if samples.tobytes() != single.samples.tobytes() or metadata != json.loads(json.dumps(single.metadata())):
            wrong.append(number)
    return wrong


def measured(folder: Path, responses: int, processes: int, receiver: str, checked: int, per_shard: int) -> bool:
    """Make, print and check; whether all that was checked is the same."""
    work = Work.drawn(responses, receiver)
    work.single(0)  # compiled kernels are not part of the rate
    begin = time.perf_counter()
    before = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    shards = acoustics.write_webdataset(work.all(processes), folder, per_shard=per_shard)
    wall = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = sum(b.ru_utime + b.ru_stime - a.ru_utime - a.ru_stime for a, b in zip(before, after, strict=True))
    count = len(work.sources) * len(work.listeners)
    size = sum(shard.stat().st_size for shard in shards)
    print(f"{count:,} responses ({receiver}, {SAMPLE_RATE} Hz) in {processes} processes: {len(shards)} shards")
    print(f"{wall:.1f} s, {count / wall:.1f} per second; {1000 * cpu / count:.1f} ms of CPU each")
    own, child = (usage.ru_maxrss / 1024 for usage in after)
    print(f"peak memory: {own:,.0f} MiB here, {child:,.0f} MiB the largest process")
    print(f"{size / 2**20:,.1f} MiB, {size / count / 1000:.1f} kB each")
    wrong = differing(work, shards, per_shard, checked)
    print(f"{min(checked, count)} checked against single calls: {f'differ: {wrong}' if wrong else 'the same bytes'}")
    return not wrong


def main() -> None:
    """Read the arguments."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="for the shards; must have none")
    parser.add_argument("--responses", type=int, default=2000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--receiver", choices=sorted(RECEIVERS), default="omni")
    parser.add_argument("--checked", type=int, default=20)
    parser.add_argument("--per-shard", type=int, default=1000)
    given = parser.parse_args()
    same = measured(given.folder, given.responses, given.processes, given.receiver, given.checked, given.per_shard)
    sys.exit(0 if same else 1)


if __name__ == "__main__":
    main()
