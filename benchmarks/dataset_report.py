"""`python -m benchmarks.dataset_report ROOT`: statistics of a generated dataset, per observation and in total."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from avs3d_bench.contract.layout import is_test
from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.measures.levels import level_db


def _rms(values: Sequence[float]) -> float:
    """RMS of a whole recording from those of its seconds."""
    return float(np.sqrt(np.mean(np.square(values))))


def facts(record: ObservationRecord) -> dict[str, float]:
    """Figures of one observation, all from observation.json; directions are those of its first source."""
    frames = record.frames
    azimuth = np.array([np.nan if f.azimuth is None else f.azimuth for f in frames])
    # Where several sources sound, the louder ear is not on the side of the first one.
    alone = record.sources is None or len(record.sources) == 1
    judged = (
        alone & (np.abs(azimuth) > 20) & (np.abs(azimuth) < 160) & np.array([bool(f.line_of_sight) for f in frames])
    )
    right = judged & (np.array([f.rms_right - f.rms_left for f in frames]) * azimuth > 0)
    visible = np.array([f.visible_pixels > 0 for f in frames])
    test = np.array([is_test(i) for i in range(len(frames))])
    position = np.array([f.position for f in frames])
    axis = np.array([f.pose.rotation_matrix[:, 2] for f in frames])
    turn = np.degrees(np.arccos(np.clip((axis[1:] * axis[:-1]).sum(axis=1), -1, 1)))
    area = record.intrinsics.width * record.intrinsics.height
    return {
        "louder ear right (%)": 100 * int(right.sum()) / max(int(judged.sum()), 1),
        "frames judged": int(judged.sum()),
        "visible (%)": 100 * visible.mean(),
        "empty test frames": int((test & ~visible).sum()),
        "test frames": int(test.sum()),
        "mask area where visible (%)": 100
        * float(np.mean([f.visible_pixels for f in frames if f.visible_pixels] or [0]))
        / area,
        "left (%)": 100 * float(np.mean(azimuth < -20)),
        "right (%)": 100 * float(np.mean(azimuth > 20)),
        "longest step (m)": float(np.linalg.norm(np.diff(position, axis=0), axis=1).max(initial=0)),
        "largest turn (°)": float(turn.max(initial=0)),
        "T30 (s)": record.acoustics.t30 or float("nan"),
        "level (dB)": level_db(_rms([f.rms_left for f in frames]), _rms([f.rms_right for f in frames])),
    }


@click.command()
@click.argument("root", type=click.Path(path_type=Path))
@click.option("--json", "output", type=click.Path(path_type=Path), default=None, help="Also write the figures here.")
def main(root: Path, output: Path | None) -> None:
    """Print a table of the dataset ROOT."""
    table = Table(
        "observation", "category", *["ear %", "vis. %", "empty", "area %", "left", "right", "step", "turn", "T30", "dB"]
    )
    rows: dict[str, dict[str, float]] = {}
    for observation in Dataset(root):
        record = observation.record
        if record is None:
            continue
        row = rows[observation.key] = facts(record)
        table.add_row(
            observation.key, record.category or "no source",
            f"{row['louder ear right (%)']:.0f} of {row['frames judged']:.0f}", f"{row['visible (%)']:.0f}",
            f"{row['empty test frames']:.0f}/{row['test frames']:.0f}", f"{row['mask area where visible (%)']:.2f}",
            f"{row['left (%)']:.0f}", f"{row['right (%)']:.0f}", f"{row['longest step (m)']:.2f}",
            f"{row['largest turn (°)']:.0f}", f"{row['T30 (s)']:.2f}", f"{row['level (dB)']:.0f}",
        )  # fmt: skip
        for note in record.notes:
            table.add_row("", note)
    Console(width=160).print(table)
    judged = sum(row["frames judged"] for row in rows.values())
    right = sum(row["louder ear right (%)"] * row["frames judged"] for row in rows.values()) / max(judged, 1)
    worst = min((row["louder ear right (%)"] for row in rows.values()), default=0.0)
    print(f"louder ear on the source's side: {right:.1f} % of {judged:.0f} frames; worst observation {worst:.0f} %")
    if output:
        write_bytes(output, f"{json.dumps(rows, indent=1)}\n".encode())


if __name__ == "__main__":
    main()
