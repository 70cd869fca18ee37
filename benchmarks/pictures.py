"""Makes the pictures of the documentation from generated datasets.

    python -m benchmarks.pictures --demo data/demo -o docs/images
    python -m benchmarks.pictures --scenes data/listen -o docs/images
    python -m benchmarks.pictures --moving data/moving-source --sh3d data/open-s34-o7-sh3d -o docs/images

Needs Chromium, and the [inspect] and [dev] extras. `--demo` takes the folder that `make demo` writes, with its
submissions beside it.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from avs3d_bench.dataset import Dataset, Frame, Observation
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import write_bytes
from avs3d_bench.inspector.contact_sheet import draw_contact_sheet, overlay
from avs3d_bench.inspector.video import write_video

SINGLE, MULTI = "part_1/apartment_1/bathroom/1", "part_2/apartment_1/kitchen/1"
#: Quality of a JPEG.
QUALITY = 82
#: Side of one picture of a pair (pixels).
PAIR = 632
#: Gap between the pictures of a pair (pixels).
GAP = 16
#: Largest share of the picture that an object covers if it is completely visible.
MOST_COVERED = 0.25
#: Names of browsers that draw the pages, for the tests too.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@click.command()
@click.option("--demo", type=click.Path(exists=True, path_type=Path), help="Dataset that `make demo` generated.")
@click.option(
    "--moving", type=click.Path(exists=True, path_type=Path), help="Dataset of scenes_manifest/moving-source.yaml."
)
@click.option(
    "--sh3d", type=click.Path(exists=True, path_type=Path), help="Dataset of scenes_manifest/open-s34-o7-sh3d.yaml."
)
@click.option(
    "--scenes", type=click.Path(exists=True, path_type=Path), help="Dataset with part_3, made `--with stems`."
)
@click.option("--gallery", type=click.Path(exists=True, path_type=Path), help="Site that `avs3d view -o` wrote.")
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder to write the pictures to.")
def main(
    demo: Path | None, moving: Path | None, sh3d: Path | None, scenes: Path | None, gallery: Path | None, output: Path
) -> None:
    """Make the pictures of the docs that the given datasets allow."""
    if demo is not None:
        submissions = demo.parent / f"{demo.name}-submissions"
        write_bytes(output / "contact-sheet.png", _sheet(Dataset(demo), MULTI, 8))
        _save(output / "video.jpg", _film_frame(Dataset(demo), submissions / "centre-box"))
        _save(output / "player.jpg", _player(demo, submissions))
        _save(output / "view-3d.jpg", _view_3d(demo, submissions / "oracle-sounding"))
    if moving is not None:
        _save(output / "moving-source.jpg", _decoded(_sheet(Dataset(moving), Dataset(moving).keys[0], 6)), width=1200)
    if sh3d is not None:
        for category, observation in _one_per_category(Dataset(sh3d)).items():
            _save(output / f"sh3d-{category}.jpg", _pair(_best_frame(observation)))
    if scenes is not None:
        shown = _richest_moment(Dataset(scenes))
        _save(output / "player-scenes.jpg", _scene_player(scenes, shown), width=1100)
        _save(output / "video-scenes.jpg", _film_picture(Dataset(scenes), shown))
    if gallery is not None:
        with _page(1360, 900) as page:
            page.goto((gallery / "index.html").resolve().as_uri())
            page.wait_for_timeout(1500)
            _save(output / "gallery.jpg", _decoded(page.screenshot()))


def _save(path: Path, picture: np.ndarray, *, width: int | None = None) -> None:
    """Write an RGB picture (H, W, 3) as a JPEG, ``width`` pixels wide."""
    if width is not None:
        size = (width, round(picture.shape[0] * width / picture.shape[1]))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done
    write_bytes(path, data.tobytes())
    print(path)


def _decoded(png: bytes) -> np.ndarray:
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture[..., ::-1])


def _sheet(dataset: Dataset, key: str, columns: int) -> bytes:
    stream = io.BytesIO()
    draw_contact_sheet(dataset, key, columns).savefig(stream, format="png", dpi=100, metadata={"Software": None})
    return stream.getvalue()


def _film_frame(dataset: Dataset, submission: Path) -> np.ndarray:
    """A picture of the first observation's film, at the test frame that shows most of the source."""
    shown = max((frame for frame in dataset[SINGLE].test if _covered(frame) <= MOST_COVERED), key=_covered)
    return _film_picture(dataset, shown, submission)


def _film_picture(dataset: Dataset, shown: Frame, submission: Path | None = None) -> np.ndarray:
    """The picture of an observation's film in the middle of a frame's second."""
    import av

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        write_video(dataset, shown.observation.key, path, submission=submission, with_map=True)
        with av.open(str(path)) as container:
            container.seek(int(shown.index * 1e6))
            for picture in container.decode(video=0):
                if picture.time >= shown.index + 0.5:
                    return np.asarray(picture.to_ndarray(format="rgb24"))
    raise Avs3dError(f"{shown.observation.key}: the film ends before {shown.name}")


def _richest_moment(dataset: Dataset) -> Frame:
    """The frame of part_3 in which most audible instances are visible; of those, the one that shows most."""

    def visible(frame: Frame) -> tuple[int, float]:
        mask = frame.mask()
        return len(np.unique(frame.instance_ids()[mask])), -abs(_covered(frame) - MOST_COVERED / 4)

    frames = [frame for observation in dataset if observation.group is not None for frame in observation.frames]
    if not frames:
        raise Avs3dError(f"{dataset.root}: no observation of part_3")
    return max(frames, key=visible)


def _scene_player(root: Path, frame: Frame) -> np.ndarray:
    """The player of a part_3 observation with its truth."""
    key = frame.observation.key
    with _served("view", str(root), "--no-browser", "--port", "0") as url, _page(1360, 960) as page:
        page.goto(f"{url}{key}/index.html#{frame.name}")
        page.wait_for_timeout(3000)
        page.keyboard.press("m")
        page.wait_for_timeout(1500)
        lanes = page.locator("#lanes").bounding_box()
        below = {"x": 0, "y": 0, "width": 1360, "height": lanes["y"] + lanes["height"] + GAP // 4}
        return _decoded(page.screenshot(full_page=True, clip=below))


def _covered(frame: Frame) -> float:
    return float(frame.mask().mean())


def _one_per_category(dataset: Dataset) -> dict[str, Observation]:
    found: dict[str, Observation] = {}
    for observation in dataset:
        record = observation.record
        assert record is not None
        if record.category is not None:
            found.setdefault(record.category, observation)
    return found


def _best_frame(observation: Observation) -> Frame:
    """The frame that shows most of the source, away from the border."""

    def whole(frame: Frame) -> float:
        mask = frame.mask()
        border = mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any()
        return 0.0 if border or mask.mean() > MOST_COVERED else float(mask.mean())

    return max(observation.frames, key=whole)


def _pair(frame: Frame) -> np.ndarray:
    """The frame, and the frame with the sounding object marked."""
    rgb = frame.rgb()
    both = [cv2.resize(p, (PAIR, PAIR), interpolation=cv2.INTER_AREA) for p in (rgb, overlay(rgb, frame.mask()))]
    return np.hstack([both[0], np.full((PAIR, GAP, 3), 255, np.uint8), both[1]])


@contextmanager
def _page(width: int, height: int) -> Iterator[Any]:
    """A page of a headless Chromium."""
    from playwright.sync_api import sync_playwright

    executable = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if executable is None:
        raise Avs3dError(f"no Chromium on this computer; looked for {', '.join(BROWSERS)}")
    with sync_playwright() as session:
        browser = session.chromium.launch(
            executable_path=executable, args=["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
        )
        try:
            yield browser.new_page(viewport={"width": width, "height": height})
        finally:
            browser.close()


@contextmanager
def _served(*command: str) -> Iterator[str]:
    """The address that a command of this project prints while it runs."""
    process = subprocess.Popen([sys.executable, "-m", "avs3d_bench", *command], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        line = next(line for line in process.stdout if "http://" in line)
        yield next(word for word in line.split() if word.startswith("http://"))
    finally:
        process.terminate()
        process.wait()


def _player(root: Path, submissions: Path) -> np.ndarray:
    """The player at a test frame, with the errors of the third submission."""
    named = [
        part
        for name in ("oracle-with-errors", "centre-box", "oracle")
        for part in ("--submission", str(submissions / name))
    ]
    frame = max((f for f in Dataset(root)[MULTI].test if _covered(f) <= MOST_COVERED), key=_covered)
    with _served("view", str(root), "--no-browser", "--port", "0", *named) as url, _page(1360, 1400) as page:
        page.goto(f"{url}{MULTI}/index.html#{frame.name}")
        page.wait_for_timeout(3000)
        page.keyboard.press("3")
        page.keyboard.press("e")
        page.wait_for_timeout(2500)
        return _decoded(page.screenshot())


def _view_3d(root: Path, submission: Path) -> np.ndarray:
    """A picture of the room in viser, half a minute after it was opened."""
    arguments = ("view-3d", SINGLE, "--dataset", str(root), "--submission", str(submission), "--port", "0")
    with _served(*arguments) as url, _page(1200, 700) as page:
        page.goto(url)
        page.wait_for_timeout(30_000)
        # viser warns of a browser that draws without a graphics card.
        notice = page.get_by_role("alert")
        if notice.count():
            notice.first.get_by_role("button").first.click()
            page.wait_for_timeout(1_000)
        return _decoded(page.screenshot())


if __name__ == "__main__":
    main()
