"""The manifest of a surveyed scan: every value that was guessed has a comment that says how it was found."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from generators.assets.sounds import voices
from generators.plan import scans_root
from generators.sampling.document import one_line
from generators.surveying.fitting import FittingObservations
from generators.surveying.survey import Survey

#: Side of the pictures (pixels) and frames of an observation: a first look takes a minute.
SIZE, FRAMES = 504, 24
#: Range of the level of each source (dB), as in the manifests of this project.
LEVELS = [-9, 0]
#: Seed of the manifest.
SEED = 34


def document_of(name: str, file: str, survey: Survey, licence: tuple[str, str] | None) -> dict[str, Any]:
    """The manifest without observations and voices; ``file``: as the manifest names it."""
    scan: dict[str, Any] = {"source": "scan", "file": file, "up": survey.up, "front": survey.front}
    scan |= {"turn": survey.turn} if survey.turn else {}
    scan |= {"scale": survey.scale} if survey.scale != 1.0 else {}
    boxes = {room: survey.boxes[number] for room, number in survey.rooms.items()}
    scan["rooms"] = {room: [list(box.low), list(box.high)] for room, box in boxes.items()}
    if licence is not None:
        scan["licence"] = {"name": licence[0], "author": licence[1]}
    return {
        "name": name,
        "version": "1.0.0",
        "seed": SEED,
        "camera": {"size": SIZE, "hfov": 90.0, "height": 1.5, "frames": FRAMES},
        "scans": {name: scan},
        "levels": LEVELS,
    }


def test_voices(categories: Iterable[str]) -> dict[str, list[str]]:
    """Category → its voices of the test split, which no training manifest draws."""
    return {name: [voice.name for voice in voices(name) if voice.split == "test"] for name in categories}


def relative_name(file: Path, manifest: Path) -> str:
    """The name of a scan's file as the manifest has it: relative to where `scans_root` looks, if that is right.

    Names are relative to the manifest's folder unless ``$AVS3D_SCANS`` is set; a file outside that folder is named in
    full.
    """
    base = manifest.resolve().parent
    root = scans_root(base).resolve()
    place = file.resolve()
    if root != base and not place.is_relative_to(root):
        return place.as_posix()
    return Path(os.path.relpath(place, root)).as_posix()


def scan_manifest(document: dict[str, Any], survey: Survey, found: FittingObservations, command: str) -> str:
    """The manifest as YAML, with the command that wrote it in its first line."""
    lines = [
        f"# {command}",
        "# All values of the scan were found on its geometry; correct what is wrong. The page beside it shows them.",
    ]
    for field in ("name", "version", "seed"):
        lines.append(f"{field}: {one_line(document[field])}")
    lines.append(
        f"camera: {one_line(document['camera'])}  # for a first look; the benchmark's: --size 1008 --frames 120"
    )
    lines += _scan_lines(document, survey)
    lines.append(f"levels: {one_line(document['levels'])}  # of each source re the common loudness, dB")
    lines.append("voices:  # of the test split: no training manifest draws them")
    lines += [f"  {name}: {one_line(names)}" for name, names in document["voices"].items()]
    lines += [f"# {what}: {_in_short(why)}" for what, why in found.refused.items()]
    lines.append("observations:")
    titles = {
        "part_1": "one object sounds",
        "part_2": "identical objects, one of them sounds",
        "part_3": "three sound scenes with the same pictures: one twin sounds, the other one, neither",
    }
    for entry in found.entries:
        part = str(entry.get("part") or str(entry["like"]).partition("/")[0])
        if part in titles:
            lines.append(f"  # {part}: {titles.pop(part)}")
        lines.append(f"  - {one_line(entry)}")
    return "\n".join(lines) + "\n"


def _scan_lines(document: dict[str, Any], survey: Survey) -> list[str]:
    """The home, one field a line with its comment."""
    ((name, scan),) = document["scans"].items()
    how = {guess.name: guess.how for guess in survey.guesses}
    comments = {
        "file": "relative to this manifest's folder, or to --scans or $AVS3D_SCANS where given",
        "up": f"axis of the file that becomes +Y: {how['up']}",
        "front": "axis of the file that becomes +Z",
        "turn": f"degrees about +Y, counter-clockwise seen from above: {how['turn']}",
        "scale": f"metres in a unit of the file: {how['scale']}",
        "surfaces": "place → acoustic material, given",
        "licence": "of the scan",
        "splats": "3D Gaussians in the frame of the file, for --vision splats",
    }
    lines = ["scans:", f"  {name}:"]
    for field, value in scan.items():
        if field != "rooms":
            comment = f"  # {comments[field]}" if field in comments else ""
            lines.append(f"    {field}: {one_line(value)}{comment}")
            continue
        lines.append("    rooms:  # lowest and highest corner of the inside, metres, Y up; named by size unless given")
        for room, number in survey.rooms.items():
            box = survey.boxes[number]
            size = f"{box.high[0] - box.low[0]:.2f} × {box.high[2] - box.low[2]:.2f} m, {box.area:.1f} m²"
            part = ", the largest rectangle of an angular room" if box.part else ""
            lines.append(f"      {room}: {one_line(value[room])}  # room {number + 1} of the plan: {size}{part}")
        for number, box in enumerate(survey.boxes):
            if number not in survey.rooms.values():
                text = one_line([list(box.low), list(box.high)])
                lines.append(f"      # room {number + 1} of the plan, {box.area:.1f} m², is not used: {text}")
    return lines


def _in_short(why: str) -> str:
    """A reason without its advice, in one line."""
    text = " ".join(why.partition(";")[0].split())
    return text if len(text) <= 160 else f"{text[:157]}…"
