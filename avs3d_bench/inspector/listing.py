"""The table of a dataset's observations that `avs3d list` prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from avs3d_bench.commands.report import screen
from avs3d_bench.contract import layout
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset, Observation
from avs3d_bench.errors import UsageError
from avs3d_bench.text.printable import printable

if TYPE_CHECKING:
    from rich.console import Console

#: Columns that a row may take: it is printed whole on a narrow terminal too.
_WIDEST = 1000


@dataclass(frozen=True)
class ListedObservation:
    """A row of the table.

    Attributes:
        key: ``part_1/<scan>/<room>/<index>``.
        category: of the sounding object; None in the official release, as for t30 and instances, and where nothing
            sounds. In part_3 that of the first source.
        frames: number of pictures.
        seconds: length of the binaural sound: a second for each clip.
        t30: reverberation time of the room (s); None where it was not measured.
        instances: number of placed objects, the sounding one included.
        sounds: of part_3: what sounds, e.g. ``microwave + telephone (living_room), noise`` or ``silence``; else None.
        group: of part_3: key of the observation whose pictures it shares; else None.
    """

    key: str
    category: str | None
    frames: int
    seconds: float
    t30: float | None
    instances: int | None
    sounds: str | None = None
    group: str | None = None


@dataclass(frozen=True)
class Listing:
    """A dataset and its observations.

    Attributes:
        name: the dataset's name.
        version: its version; None without dataset.json.
        observations: the rows, sorted by key.
    """

    name: str
    version: str | None
    observations: tuple[ListedObservation, ...]

    def as_dict(self) -> dict[str, Any]:
        """The content of `avs3d list --json`."""
        # The two fields of part_3 are left out elsewhere, so that files of other datasets keep their bytes.
        rows = [
            {name: value for name, value in asdict(row).items() if name not in ("sounds", "group") or row.group}
            for row in self.observations
        ]
        return {"dataset": {"name": self.name, "version": self.version}, "observations": rows}


def list_dataset(dataset: Dataset, only: Iterable[str] = ()) -> Listing:
    """Read the rows of a dataset's table; no picture or sound is opened.

    Args:
        dataset: ours or the official release.
        only: shell patterns of observation keys; all without patterns.

    Raises:
        UsageError: if no observation matches.
        Avs3dError: if a record is damaged.
    """
    patterns = tuple(only)
    chosen = dataset.select(*patterns)
    if patterns and not chosen:
        near = f"; keys look like {dataset.keys[0]!r}" if dataset.keys else ""
        raise UsageError(f"{dataset.root}: no observation matches {' '.join(patterns)}{near}")
    return Listing(dataset.name, dataset.version, tuple(map(_row, chosen)))


def _row(observation: Observation) -> ListedObservation:
    record = observation.record
    clips = len(list((observation.path / layout.BINAURAL).glob("frame_*.wav")))
    return ListedObservation(
        key=observation.key,
        category=observation.category,
        frames=len(observation),
        seconds=clips * layout.BINAURAL_SAMPLES / layout.SAMPLE_RATE,
        t30=record.acoustics.t30 if record else None,
        instances=len(record.instances) if record else None,
        sounds=describe_sound(record) if record else None,
        group=observation.group,
    )


def describe_sound(record: ObservationRecord) -> str | None:
    """The sources of a part_3 observation in a few words; None in the other parts.

    Off-screen sources have their room behind them; a background comes last.
    """
    if record.sources is None:
        return None
    sources = [s.category if s.instance is not None else f"{s.category} ({s.room})" for s in record.sources]
    text = " + ".join(f"{count} × {name}" if count > 1 else name for name, count in Counter(sources).items())
    noise = record.background.kind.replace("_", " ") if record.background else ""
    return ", ".join(part for part in (text or "silence", noise) if part)


def _pictures(row: ListedObservation) -> str:
    """The number of the observation of the same room whose pictures a row shares."""
    return "" if row.group in (None, row.key) else printable(f"…/{str(row.group).rpartition('/')[2]}")


def print_listing(listing: Listing, console: Console | None = None) -> None:
    """Print the table, and below it the name, the version and the totals."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    out = console or screen()
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    scenes = any(row.sounds for row in listing.observations)
    what = "sounds" if scenes else "category"
    for title in ("key", what, "frames", "sound s", "T30 s", "instances"):
        table.add_column(title, justify="left" if title in ("key", what) else "right", no_wrap=True)
    if scenes:
        table.add_column("pictures of", justify="left", no_wrap=True)
    for row in listing.observations:
        table.add_row(
            printable(row.key),
            row.sounds or row.category or "–",
            str(row.frames),
            f"{row.seconds:g}",
            "–" if row.t30 is None else f"{row.t30:.2f}",
            "–" if row.instances is None else str(row.instances),
            *([_pictures(row)] if scenes else []),
        )
    if listing.observations:
        table.width = out.measure(table, options=out.options.update(max_width=_WIDEST)).maximum
        out.print(table, soft_wrap=True)
    count = len(listing.observations)
    version = f" {listing.version}" if listing.version else ""
    frames = sum(row.frames for row in listing.observations)
    line = f"{listing.name}{version}: {count} observation{'' if count == 1 else 's'}, {frames:,} frames"
    out.print(Text(printable(line)), soft_wrap=True)
