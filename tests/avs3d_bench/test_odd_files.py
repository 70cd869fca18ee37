"""Special files (FIFOs, devices, …) in place of a dataset's files, and roots whose names are not UTF-8."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from avs3d_bench.contract.schema import ObservationRecord
from avs3d_bench.dataset import Dataset
from avs3d_bench.formats import media
from avs3d_bench.validate import validate
from tests.support import tiny

#: Seconds after which a check counts as hung; it takes one or two.
LIMIT = 60
#: One file of every kind that a dataset holds.
KINDS = (
    "dataset.json", "observation.json", "camera_splits.json", "input/frame_003.png", "images/frame_003.png",
    "semantic_masks/frame_003.png", "instance_masks/frame_003.png", "depth/frame_003.png",
    "audio_clips_binaural/frame_3.wav", "audio_clips_mono/frame_3.wav", "rirs/frame_3.npz", "sparse/0/cameras.bin",
    "sparse/0/images.bin", "sparse/0/points3D.bin", "gt_3d/sounding_object.ply",
)  # fmt: skip
#: Checks every copy below a folder, and prints the errors of each.
_CHECK_ALL = """
import json, sys
from pathlib import Path
from avs3d_bench.validate import validate
found = {}
for root in sorted(Path(sys.argv[1]).iterdir()):
    for deep in (False, True):
        found[f"{root.name} {deep}"] = [(p.path, p.message) for p in validate(root, deep=deep).problems]
print(json.dumps(found))
"""


def _run(*arguments: str | bytes) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([sys.executable, *arguments], capture_output=True, timeout=LIMIT, check=False)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no FIFOs")
@pytest.mark.parametrize("release", [False, True], ids=["ours", "release"])
def test_a_fifo_in_the_place_of_any_file_is_named(tmp_path: Path, release: bool):
    if release:
        pristine = tiny.write_release(tmp_path / "data", frames=4, size=24)
    else:
        pristine = tiny.write_dataset(tmp_path / "data", frames=4, size=24, extras=True)
    roots = tmp_path / "copies"
    expected = {}
    for number, kind in enumerate(KINDS):
        place = kind if kind == "dataset.json" else f"{tiny.SINGLE}/{kind}"
        if not (pristine / place).exists():
            continue
        root = tiny.clone(pristine, roots / f"{number:02d}")
        (root / place).unlink()
        os.mkfifo(root / place)
        expected[root.name] = place
    done = _run("-c", _CHECK_ALL, str(roots))
    assert done.returncode == 0, done.stderr.decode()
    found = json.loads(done.stdout)
    for name, place in expected.items():
        for deep in (False, True):
            named = [message for path, message in found[f"{name} {deep}"] if path == place]
            fifo = [message for message in named if "a FIFO; expected a regular file" in message]
            assert len(fifo) == 1, (place, deep, named)


@pytest.mark.parametrize("sizes", [False, True])
def test_shallow_checks_name_what_only_deep_ones_would_open(tmp_path: Path, sizes: bool):
    root = tiny.write_dataset(tmp_path / "data", frames=2, size=16)
    folder = root / tiny.SINGLE
    if sizes:
        record = media.read_record(folder / "observation.json", ObservationRecord)
        held = {name: (folder / name).stat().st_size for name in record.files}
        media.write_json(folder / "observation.json", record.model_copy(update={"sizes": held}))
    (folder / "sparse/0/points3D.bin").unlink()
    os.mkfifo(folder / "sparse/0/points3D.bin")
    (folder / "gt_3d/sounding_object.ply").unlink()
    (folder / "gt_3d/sounding_object.ply").symlink_to("nowhere.ply")
    found = {problem.path.removeprefix(f"{tiny.SINGLE}/"): problem.message for problem in validate(root).problems}
    assert found["sparse/0/points3D.bin"] == "a FIFO; expected a regular file"
    assert "no such file" in found["gt_3d/sounding_object.ply"]


def test_a_device_is_not_read(tmp_path: Path):
    root = tiny.write_dataset(tmp_path / "data", frames=2, size=16)
    clip = root / tiny.SINGLE / "audio_clips_mono/frame_1.wav"
    clip.unlink()
    clip.symlink_to("/dev/zero")
    done = _run("-m", "avs3d_bench", "validate", str(root), "--deep", "--workers", "1")
    assert done.returncode == 1
    assert b"audio_clips_mono/frame_1.wav: a device; expected a regular file" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("damaged", [False, True])
def test_a_root_that_is_no_utf8_is_checked(tmp_path: Path, damaged: bool):
    root = tiny.write_dataset(tmp_path / os.fsdecode(b"d\xe9j\xe0 vu"), frames=3, size=16, extras=True)
    if damaged:
        os.rename(root / tiny.SINGLE / "input/frame_001.png", root / tiny.SINGLE / os.fsdecode(b"input/\xff.png"))
    report = tmp_path / os.fsdecode(b"\xfe.json")
    done = _run("-m", "avs3d_bench", "validate", os.fsencode(root), "--deep", "--json", os.fsencode(report))
    assert done.stderr == b""
    assert done.returncode == damaged
    assert b"d\\udce9j\\udce0 vu" in done.stdout.splitlines()[-1]
    data = json.loads(report.read_bytes())
    assert data["valid"] is not damaged
    assert os.fsencode(data["root"]) == os.fsencode(root)
    assert [f.rgb().shape for f in Dataset(root)[tiny.MULTI].frames] == [(16, 16, 3)] * 3
