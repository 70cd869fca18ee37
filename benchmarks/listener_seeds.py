"""`python -m benchmarks.listener_seeds SCORES … -o FILE.json`: figures of several training seeds, row by row.

Each folder has the files of `benchmarks.listener_tables` for one seed, and those of `benchmarks.listener_classes` as
``classes-DATASET.json``. Of each row and dataset, the file has strict IoU of each part and category, and under
``listen`` the pair accuracy by kind of pair: the mean over the seeds, the value of each, and the interval over homes
of the first seed; how many observations each has; and how often something is marked where nothing in the room sounds.
``DATASET-classes`` has what the network sees. `--table` prints the rows as a table.

docs/results/listener-seeds.json is of three seeds, listener-seeds-package.json of the package's weights, one of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from statistics import fmean
from typing import Any

import click

from avs3d_bench.contract.scores import Scores
from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.formats.files import read_json, write_json
from avs3d_bench.formats.media import read_record
from baselines.sound_control import SOUND_CONTROLS, SoundControl
from benchmarks.listener_summary import MISSING, share
from benchmarks.listener_tables import HEARD, ROWS, RUN_JSON
from benchmarks.sound_rows import LISTEN_FIGURES, row_of

#: Datasets of strict IoU in the docs: its name in files of scores → what differs.
TESTS = {
    "open-s34-o7": "test voices", "open-s34-o7-recorded": "recordings", "open-s34-o7-heads": "other heads",
    "open-s34-o7+soundspaces": "other engine", "open-s34-o7-sh3d": "other models", "open-scans": "a real room",
    "open-s34-o7-24frames": "test voices, 24 frames", "open-s34-o7-pathtraced": "path-traced pictures, 24 frames",
}  # fmt: skip
#: Datasets of part_3, and what they play.
SCENES = {"listen": "test voices", "listen-recorded": "recordings"}
#: Datasets whose pictures differ, for what the network sees.
PICTURES = ("open-s34-o7", "open-s34-o7-sh3d", "open-scans")
#: Rows that need no other sound.
ANSWERS = {
    "2d": "network", "direction": "direction", "both": "both", "official": "EchoSegnet official",
    "spatial": "EchoSegnet spatial, by name", "spatial-direction": "EchoSegnet spatial, by direction",
}  # fmt: skip
#: What runs are called in the docs: name in files (empty: the three seeds) → title.
RUNS = {"package": "package", "": "three seeds"}
#: Parts that have strict IoU.
PARTS = ("part_1", "part_2")
#: Columns of the summary: title → dataset, part, metric.
SUMMARY = {
    "test voices, part_1": ("open-s34-o7", "part_1", "strict_IoU"),
    "test voices, part_2": ("open-s34-o7", "part_2", "strict_IoU"),
    "recordings, part_1": ("open-s34-o7-recorded", "part_1", "strict_IoU"),
    "recordings, part_2": ("open-s34-o7-recorded", "part_2", "strict_IoU"),
    "listen, all pairs": ("listen", "part_3", "pair_accuracy"),
    "listen, twins": ("listen", "part_3", "twins"),
}


def figures_of(folders: tuple[Path, ...]) -> dict[str, dict[str, Any]]:
    """``DATASET-ROW`` → group → metric → {"mean", "values", "interval"}; rows that all folders have."""
    found: dict[str, dict[str, Any]] = {}
    for name, files in _in_all(folders, "listener-"):
        if files[0].name == RUN_JSON:
            continue
        each_scores = [read_record(file, Scores) for file in files]
        rows = [row_of(scores) for scores in each_scores]
        found[name] = {
            group: {metric: _over([row[group][metric] for row in rows]) for metric in metrics}
            for group, metrics in rows[0].items()
            if isinstance(metrics, dict)
        } | {"observations": [row["observations"] for row in rows]}
        if marked := _plain([_marked_without_sound(scores) for scores in each_scores]):
            found[name]["marked"] = marked
    for name, files in _in_all(folders, "classes-"):
        each = [one for file in files for one in read_json(file)["datasets"].values()]
        found[f"{name}-classes"] = {
            "classes": _plain([one["class_iou"] for one in each]),
            "masks": _plain([{name: one[name] for name in ("calibration_error", "average_precision")} for one in each]),
        }
    return found


def _marked_without_sound(scores: Scores) -> dict[str, float | None]:
    """Of part_3, share of frames in which something is marked, in silence and where all sounds are of other rooms."""
    found: dict[str, list[float]] = {"silence": [], "other_rooms": []}
    for one in scores.observations:
        if one.listen is not None and one.listen.FP_rate is not None and not one.listen.visible_frames:
            found["other_rooms" if one.category else "silence"].append(one.listen.FP_rate)
    return {name: fmean(rates) if rates else None for name, rates in found.items()}


def _in_all(folders: tuple[Path, ...], prefix: str) -> Iterator[tuple[str, list[Path]]]:
    """Of each JSON file that all folders have, what its name has after ``prefix``, and its paths."""
    for path in sorted(folders[0].glob(f"{prefix}*.json")):
        files = [folder / path.name for folder in folders]
        if all(file.exists() for file in files):
            yield path.stem.removeprefix(prefix), files


def _plain(each: list[dict[str, float | None]]) -> dict[str, Any]:
    """Figures without intervals; without those of what no picture shows, or only some seeds take something for."""
    names = [name for name in each[0] if all(one.get(name) is not None for one in each)]
    return {name: _over([{"value": one[name], "interval": None} for one in each]) for name in names}


def _over(each: list[dict[str, Any]]) -> dict[str, Any]:
    values = [figure["value"] for figure in each]
    return {
        "mean": round(fmean(values), 9), "values": values, "interval": each[0]["interval"],
    }  # fmt: skip


def table(found: dict[str, dict[str, Any]]) -> list[list[str]]:
    """Rows: dataset, row, and for each part its headline figures with the range over the seeds."""
    lines = []
    for name, groups in found.items():
        if name.endswith("-classes"):
            continue
        row = next((known for known in sorted(ROWS, key=len, reverse=True) if name.endswith(f"-{known}")), name)
        cells = [
            f"{part} {metric} {cell(figure)}"
            for part, metrics in groups.items()
            if part.startswith("part_")
            for metric, figure in metrics.items()
        ]
        lines.append([name.removesuffix(f"-{row}"), row, "; ".join(cells)])
    return lines


def strict_rows(runs: Mapping[str, Any]) -> list[list[str]]:
    """Rows of strict IoU for the docs: what sounds, the answer, and for each part a cell for each run.

    An answer with the figures of the one above it is in the same row.

    Args:
        runs: name in `RUNS` → what `figures_of` found.
    """
    rows: list[list[str]] = []
    for data, title in TESTS.items():
        for row, answer in ANSWERS.items():
            if not any(f"{data}-{row}" in found for found in runs.values()):
                continue
            cells = [each for part in PARTS for each in _cells(runs, f"{data}-{row}", part, "strict_IoU")]
            if rows and rows[-1][0] == title and rows[-1][2:] == cells:
                rows[-1][1] += f" and {answer}"
            else:
                rows.append([title, answer, *cells])
    return rows


def listen_rows(runs: Mapping[str, Any]) -> list[list[str]]:
    """Rows of `SCENES` for the docs: what sounds, the answer, the run, and a cell for each of `LISTEN_FIGURES`."""
    return [
        [sounds, answer, RUNS[run], *(_cells({run: found}, name, "part_3", one)[0] for one in LISTEN_FIGURES)]
        for data, sounds in SCENES.items()
        for row, answer in ANSWERS.items()
        for run, found in runs.items()
        if (name := f"{data}-{row}") in found
    ]


def _cells(runs: Mapping[str, Any], name: str, part: str, metric: str) -> list[str]:
    """A cell for each run; a dash where a run lacks the figure."""
    figures = [found.get(name, {}).get(part, {}).get(metric) for found in runs.values()]
    return [cell(figure) if figure else MISSING for figure in figures]


def class_columns(runs: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What `class_rows` has columns of: each of `PICTURES`, and each run that has its figures."""
    return [(data, run) for data in PICTURES for run, found in runs.items() if f"{data}-classes" in found]


def class_rows(runs: Mapping[str, Any]) -> list[list[str]]:
    """Rows of what the network sees: the figure, and a cell for each of `class_columns`; see `strict_rows`."""
    figures = {
        **{name: ("classes", f"IoU, {name.replace('_', ' ')}") for name in CATEGORIES},
        "calibration_error": ("masks", "calibration error above .1"),
        "average_precision": ("masks", "average precision"),
    }
    return [
        [title, *(_cells({run: runs[run]}, f"{data}-classes", group, name)[0] for data, run in class_columns(runs))]
        for name, (group, title) in figures.items()
    ]


def control_rows(found: Mapping[str, Any]) -> list[list[str]]:
    """Rows of each dataset and answer, first seed: a cell for each of `--sound`; answers with equal cells share a row.

    Cells have strict IoU of part_1 and part_2, of `SCENES` the pair accuracy of twins and of all pairs.
    """
    rows: list[list[str]] = []
    for data, title in {**TESTS, **{data: f"`{data}`, {title}" for data, title in SCENES.items()}}.items():
        scenes = [("part_3", metric) for metric in ("twins", "pair_accuracy")]
        wanted = scenes if data in SCENES else [(part, "strict_IoU") for part in PARTS]
        for answer, said in ANSWERS.items():
            cells = [
                ", ".join(share(found[name][part][metric]["values"][0]) for part, metric in wanted)
                if (name := f"{data}-{_heard_as(answer, sound)}") in found
                else MISSING
                for sound in SOUND_CONTROLS
            ]
            if set(cells[1:]) == {MISSING}:
                continue
            if rows and rows[-1][0] == title and rows[-1][2:] == cells:
                rows[-1][1] += f" and {said}"
            else:
                rows.append([title, said, *cells])
    return rows


def _heard_as(answer: str, sound: SoundControl) -> str:
    """Name of the row that has an answer with a sound; empty without one."""
    own = ROWS[answer]
    for row in ROWS.values():
        same = (row.kind in HEARD, row.setting, row.answer) == (own.kind in HEARD, own.setting, own.answer)
        if same and row.sound == sound:
            return row.name
    return ""


def category_rows(found: Mapping[str, Any]) -> list[list[str]]:
    """Rows of strict IoU by category on `open-s34-o7`, first seed: the answer, and a cell for each of `CATEGORIES`."""
    return [
        [answer, *(share(found[name].get(each, {}).get("strict_IoU", {}).get("mean")) for each in CATEGORIES)]
        for row, answer in ANSWERS.items()
        if (name := f"open-s34-o7-{row}") in found
    ]


def summary_rows(found: Mapping[str, Any]) -> list[list[str]]:
    """Rows of the summary: each of `ANSWERS`, and a cell for each of `SUMMARY`."""
    rows = [
        [title, *(_cells({"": found}, f"{data}-{row}", part, metric)[0] for data, part, metric in SUMMARY.values())]
        for row, title in ANSWERS.items()
    ]
    return [row for row in rows if set(row[1:]) != {MISSING}]


def cell(figure: Mapping[str, Any]) -> str:
    """``.336 (.286–.405)``, the range over seeds; of one seed ``.316 [.20–.46]``, its interval over homes, if any."""
    if len(figure["values"]) > 1:
        return f"{share(figure['mean'])} ({share(min(figure['values']))}–{share(max(figure['values']))})"
    bounds = figure["interval"]
    return share(figure["mean"]) + (f" [{share(bounds[0], 2)}–{share(bounds[1], 2)}]" if bounds else "")


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True)
@click.option("--table", "show", is_flag=True, help="Print the figures as a table.")
def main(folders: tuple[Path, ...], output: Path, show: bool) -> None:
    """Collect the figures of several training seeds."""
    found = figures_of(folders)
    write_json(output, found)
    for cells in table(found) if show else ():
        click.echo(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
