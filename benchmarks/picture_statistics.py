"""Statistics of pictures, to hold them against photographs.

    python -m benchmarks.picture_statistics --dataset data/open-s34-o7 --homes 5 --name 4.0.0
    python -m benchmarks.picture_statistics --manifest scenes_manifest/open-s34-o7.yaml --name 4.0.0
    python -m benchmarks.picture_statistics --pictures FOLDER --name photographs
    python -m benchmarks.picture_statistics --panorama lebombo_1k.jpg --name "photograph of a room"

Writes the figures of ``--name`` into docs/results/picture-statistics.json, beside those of other names, and prints a
table of all. Of each picture:

- mean colour (sRGB, 0 to 255); contrast: standard deviation of brightness; saturation: mean of (max − min) / max.
  Brightness is the luma of the encoded picture, 0 to 1 (weights of ITU-R BT.709).
- shares of pixels that are clipped (a channel ≥ 254), white (all channels ≥ 254) and black (all ≤ 2).
- slope of the power spectrum: of brightness, in the largest central square, less its weighted mean and times a Hann
  window in both directions; mean power in `BINS` rings of equal width in log frequency, from `BAND`'s lower end (cycles
  a picture) to its upper end (cycles a pixel), and a straight line through their logarithms. 0 is white noise; see
  `PUBLISHED` for photographs.
- noise: J. Immerkær, "Fast noise variance estimation", Computer Vision and Image Understanding 64(2), 1996, in blocks
  of 8 × 8 pixels without clipped ones; the lower quartile of the blocks, in steps of 8 bits.

A panorama (equirectangular) is seen as our cameras would: 90°, `YAWS` directions, `SIZE` pixels. Of a panorama 1,024
pixels wide that is its own resolution. viser, of [inspect], brings some in ``_assets/hdri`` (Poly Haven, CC0): lebombo,
st_fagans_interior and empty_warehouse_01 of interiors, forest_slope, kiara_1_dawn, rooitou_park, potsdamer_platz and
venice_sunset of outdoors.

``--homes N`` also puts a grey card (18 %) into the middle of each room of N homes that no manifest uses: the five upper
faces of a cube, rendered without the camera's noise. Figures are red over green and blue over green of the mean of the
faces, as encoded in the picture, and in linear light. Without pictures they are added to the figures of ``--name``.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_json, write_bytes

Picture = NDArray[np.uint8]
Array = NDArray[np.float64]

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "picture-statistics.json"
#: Weights of red, green and blue in luma (ITU-R BT.709).
LUMA = np.array([0.2126, 0.7152, 0.0722])
#: From this value on a channel is clipped; up to this one it is black.
CLIPPED, BLACK = 254, 2
#: Lower end (cycles a picture) and upper end (cycles a pixel) of the band of the slope, and number of rings.
BAND, BINS = (4.0, 0.25), 16
#: Second difference in both directions, and the root of its sum of squares (Immerkær 1996).
_MASK = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
_GAIN = 6.0
#: Side of the blocks in which noise is measured (pixels).
BLOCK = 8
#: Frames of each observation of a dataset that are measured: every so-many-th.
EVERY = 8
#: Directions (degrees) and pitch (degrees) of the views of a panorama.
YAWS, TILT = (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0), -10.0
#: Side (pixels) and frames of an observation that is made for ``--manifest``.
SIZE, FRAMES = 252, 9
#: Side of the grey cube and height of its middle (m), its reflectance, side of its pictures (pixels).
CARD, CARD_HEIGHT, GREY, CARD_SIZE = 0.2, 1.2, 0.18, 96
#: Key of a row's grey cards.
CARDS = "grey card"
#: Largest distance from neutral of a grey card's ratios.
NEUTRAL = 0.05
#: Slopes of power spectra of photographs in the literature: twice those of amplitude that D. J. Tolhurst, Y. Tadmor and
#: T. Chao, "Amplitude spectra of natural images", Ophthalmic & Physiological Optics 12(2), 1992, give for 135
#: photographs (−1.2, from −0.8 to −1.5), and for what several studies before had suggested (−1).
PUBLISHED = {"135 photographs of nature (Tolhurst et al. 1992)": -2.4, "suggested before (the same)": -2.0}


def luma(picture: Picture) -> Array:
    """(H, W) brightness in [0, 1] of an encoded picture (H, W, 3)."""
    return np.asarray(picture.astype(np.float64) @ LUMA / 255.0)


def spectral_slope(brightness: Array) -> float:
    """Slope of the power spectrum of a picture (H, W) over log frequency; see the module.

    Raises:
        Avs3dError: if the picture is smaller than 64 pixels: the band has no rings.
    """
    side = min(brightness.shape)
    if side < 64:
        raise Avs3dError(f"a picture of {brightness.shape[1]} × {brightness.shape[0]} pixels: expected 64 or more")
    top, left = ((length - side) // 2 for length in brightness.shape)
    square = brightness[top : top + side, left : left + side]
    window = np.outer(np.hanning(side), np.hanning(side))
    weighted = (square - np.average(square, weights=window)) * window
    power = np.abs(np.fft.fft2(weighted)) ** 2
    axis = np.fft.fftfreq(side, 1.0 / side)
    frequency = np.hypot(axis[:, None], axis)
    edges = np.geomspace(BAND[0], BAND[1] * side, BINS + 1)
    ring = np.digitize(frequency, edges) - 1
    chosen = [ring == n for n in range(BINS)]
    # The power of black is rounding.
    means = [(np.log(frequency[own]).mean(), np.log(power[own].mean() + 1e-12)) for own in chosen if own.any()]
    x, y = np.array(means).T
    return float(np.polyfit(x, y, 1)[0])


def noise(brightness: Array) -> float:
    """Standard deviation of the noise of a picture (H, W), in 255ths; NaN if all of it is clipped."""
    detail = np.abs(ndimage.convolve(brightness, _MASK, mode="nearest"))
    usable = (brightness > BLACK / 255) & (brightness < CLIPPED / 255)
    height, width = (length // BLOCK * BLOCK for length in brightness.shape)

    def blocks(values: NDArray[Any]) -> NDArray[Any]:
        tiles = values[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
        return np.asarray(tiles.mean(axis=(1, 3)))

    estimate = np.sqrt(np.pi / 2) / _GAIN * blocks(detail)[blocks(usable) == 1.0]
    return 255.0 * float(np.quantile(estimate, 0.25)) if len(estimate) else float("nan")


def statistics(picture: Picture) -> dict[str, float]:
    """The figures of one picture (H, W, 3), sRGB."""
    brightness, high, low = luma(picture), picture.max(axis=2), picture.min(axis=2)
    red, green, blue = picture.reshape(-1, 3).mean(axis=0)
    return {
        "red": float(red),
        "green": float(green),
        "blue": float(blue),
        "contrast": float(brightness.std()),
        "saturation": float(((high - low) / np.maximum(high, 1.0)).mean()),
        "clipped": float((high >= CLIPPED).mean()),
        "white": float((low >= CLIPPED).mean()),
        "black": float((high <= BLACK).mean()),
        "slope": spectral_slope(brightness),
        "noise": noise(brightness),
    }


def summary(rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Means over the pictures; of slope and noise the medians, and of the slope the standard deviation, too.

    Raises:
        Avs3dError: if there are no pictures.
    """
    if not rows:
        raise Avs3dError("no pictures: expected a dataset with frames, or a folder with .png, .jpg or .webp")
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    found = {name: float(np.nanmean(values)) for name, values in columns.items()}
    found |= {name: float(np.nanmedian(columns[name])) for name in ("slope", "noise")}
    return {"pictures": len(rows), **found, "slope_deviation": float(columns["slope"].std())}


def pictures_of(folder: Path) -> Iterator[Picture]:
    """The pictures in a folder and those below it, in the order of their paths."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in (".png", ".jpg", ".jpeg", ".webp"):
            picture = cv2.imread(str(path))
            if picture is not None:
                yield np.asarray(picture[..., ::-1], dtype=np.uint8)


def views_of(panorama: Path) -> Iterator[Picture]:
    """Views (SIZE, SIZE, 3) of an equirectangular picture.

    Raises:
        Avs3dError: if the file holds no picture that is twice as wide as high.
    """
    found = cv2.imread(str(panorama))
    if found is None or found.shape[1] != 2 * found.shape[0]:
        raise Avs3dError(f"{panorama}: expected an equirectangular picture, twice as wide as high")
    axis = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
    x, y = np.meshgrid(axis, -axis)
    tilt = np.radians(TILT)
    up, ahead = y * np.cos(tilt) + np.sin(tilt), np.cos(tilt) - y * np.sin(tilt)
    row = (0.5 - np.arctan2(up, np.hypot(x, ahead)) / np.pi) * found.shape[0] - 0.5
    for yaw in YAWS:
        turn = np.arctan2(x, ahead) + np.radians(yaw)
        column = (turn / (2 * np.pi) * found.shape[1] - 0.5) % found.shape[1]
        maps = column.astype(np.float32), row.astype(np.float32)
        view = cv2.remap(found, *maps, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        yield np.asarray(view[..., ::-1], dtype=np.uint8)


def frames_of(root: Path) -> Iterator[Picture]:
    """Every `EVERY`-th frame of each observation of a dataset."""
    for observation in Dataset(root):
        for frame in observation.frames[::EVERY]:
            yield frame.rgb()


def frames_of_manifest(manifest: Path, only: Sequence[str], vision: Any) -> Iterator[Picture]:
    """Frames of a manifest's observations, small ones, made for this.

    Raises:
        Avs3dError: if one of them cannot be made.
    """
    from generators import generate

    with tempfile.TemporaryDirectory() as folder:
        outcome = generate(
            manifest, folder, only=only, audio="analytic", frames=FRAMES, size=SIZE, vision=vision, workers=1
        )
        if outcome.failed:
            raise Avs3dError(f"{manifest.name}: {outcome.failed[0][0]}: {outcome.failed[0][1]}")
        yield from frames_of(Path(folder))


def card_colours(scene: Any, room: str) -> Array:
    """(5, 3) mean colours in linear display light of the upper faces of a grey cube in the middle of a room."""
    from avs3d_bench.geometry import Intrinsics, Pose
    from generators.assets.shapes import MeshBuilder
    from generators.core.scene import Material, Part
    from generators.core.tone import decode_table
    from generators.lighting.bake import insert
    from generators.vision.embree import EmbreeBackend

    box = scene.room(room)
    middle = (np.array(box.low) + np.array(box.high)) / 2
    middle[1] = box.low[1] + CARD_HEIGHT
    mesh = MeshBuilder().box((CARD,) * 3, tuple(middle), Material("grey_card", "plastic", (GREY,) * 3)).build()
    lit = insert(scene.for_room(room), (Part("grey_card", mesh, instance_id=1),))
    session = EmbreeBackend().open(lit, Intrinsics.from_fov(CARD_SIZE, 40.0))
    seen: dict[int, list[Array]] = {}
    last = sum(len(part.mesh.positions) for part in lit.parts[:-1])
    normal = np.concatenate([part.mesh.normals[:, 0] for part in lit.parts])
    for yaw in (45.0, 225.0):
        pose = Pose.from_yaw(middle, np.radians(yaw), np.radians(-35.0))
        away = pose.rotation_matrix[:, 2] * 0.8
        view = session.render(Pose.from_yaw(middle + away, np.radians(yaw), np.radians(-35.0)))
        # Neighbours of other things are mixed into the pixels at the rim.
        face = np.where(ndimage.binary_erosion(view.instance_ids == 1, iterations=2), session.faces, -1)
        for axis in np.unique(np.round(normal[face[face >= last]]), axis=0):
            own = (face >= last) & (np.abs(normal[np.maximum(face, 0)] - axis).max(axis=2) < 0.01)
            if own.sum() > 20:
                seen.setdefault(hash(tuple(axis)), []).append(decode_table()[view.rgb[own]].mean(axis=0))
    session.close()
    return np.array([np.mean(colours, axis=0) for colours in seen.values()])


def grey_cards(homes: int) -> dict[str, Any]:
    """Ratios of a grey card's red and blue to its green, in each room of some homes; see the module."""
    from benchmarks.home_views import home_plans
    from generators.core.folders import default_cache
    from generators.core.tone import srgb_encode
    from generators.homes.store import open_home

    found: dict[str, dict[str, Any]] = {}
    for number, plan in enumerate(home_plans(homes), start=1):
        home = open_home(plan, default_cache())
        cards = {room.name: card_colours(home, room.name).mean(axis=0) for room in home.rooms}
        cards["all rooms"] = np.mean(list(cards.values()), axis=0)
        found[f"home_{number}"] = {
            room: {"encoded": _ratios(srgb_encode(colour)), "linear": _ratios(colour)} for room, colour in cards.items()
        }
    return found


def _ratios(colour: Array) -> list[float]:
    """Red over green and blue over green."""
    return [round(float(colour[0] / colour[1]), 4), round(float(colour[2] / colour[1]), 4)]


def is_neutral(card: Mapping[str, Sequence[float]]) -> bool:
    """Whether a card's encoded red and blue are within `NEUTRAL` of its green."""
    return all(abs(ratio - 1.0) <= NEUTRAL for ratio in card["encoded"])


def table(results: Mapping[str, Mapping[str, Any]]) -> str:
    """The figures of all names as a Markdown table."""
    lines = [
        "| pictures | number | mean RGB | contrast | saturation | clipped | white | black | slope | noise | grey card, "
        "R/G and B/G | neutral homes |",
        "|---" * 12 + "|",
    ]
    for name, found in results.items():
        homes = [rooms["all rooms"] for rooms in found.get(CARDS, {}).values()]
        ratios = np.mean([home["encoded"] for home in homes], axis=0) if homes else None
        card = "–" if ratios is None else f"{ratios[0]:.2f}, {ratios[1]:.2f}"
        neutral = f"{sum(map(is_neutral, homes))} of {len(homes)}" if homes else "–"
        lines.append(
            f"| {name} | {found['pictures']} | {found['red']:.0f} / {found['green']:.0f} / {found['blue']:.0f} | "
            f"{found['contrast']:.3f} | {found['saturation']:.3f} | {found['clipped']:.2%} | {found['white']:.2%} | "
            f"{found['black']:.2%} | {found['slope']:.2f} ± {found['slope_deviation']:.2f} | {found['noise']:.2f} | "
            f"{card} | {neutral} |"
        )
    return "\n".join(lines)


@click.command()
@click.option("--dataset", type=click.Path(exists=True, path_type=Path), help="Folder of a dataset.")
@click.option(
    "--manifest", type=click.Path(exists=True, path_type=Path), help="Manifest, of which small frames are made."
)
@click.option("--pictures", type=click.Path(exists=True, path_type=Path), help="Folder of pictures.")
@click.option(
    "--panorama", "panoramas", multiple=True, type=click.Path(exists=True, path_type=Path), help="Repeatable."
)
@click.option("--only", multiple=True, help="Of --manifest: shell pattern of observation keys; repeatable [all].")
@click.option("--vision", default=None, help="Of --manifest: renderer.")
@click.option("--homes", default=0, show_default=True, help="Homes with a grey card in each room.")
@click.option("--name", required=True, help="Of the figures: the version of the pictures.")
@click.option("--json", "output", type=click.Path(path_type=Path), default=RESULTS, show_default="docs/results")
def main(
    dataset: Path | None,
    manifest: Path | None,
    pictures: Path | None,
    panoramas: tuple[Path, ...],
    only: tuple[str, ...],
    vision: str | None,
    homes: int,
    name: str,
    output: Path,
) -> None:
    """Measure the pictures of a dataset, a manifest or a folder."""
    sources: list[Iterable[Picture]] = []
    if dataset is not None:
        sources.append(frames_of(dataset))
    if manifest is not None:
        sources.append(frames_of_manifest(manifest, only, vision))
    if pictures is not None:
        sources.append(pictures_of(pictures))
    if panoramas:
        sources.append(picture for panorama in panoramas for picture in views_of(panorama))
    results = read_json(output) if output.exists() else {}
    if len(sources) > 1 or (not sources and not (homes and name in results)):
        raise click.UsageError(
            "name one of --dataset, --manifest, --pictures and --panorama; none to add --homes to the figures of --name"
        )
    try:
        found = summary([statistics(picture) for picture in sources[0]]) if sources else results[name]
        if homes:
            found[CARDS] = grey_cards(homes)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    # The card of a row stays: it is of homes, and pictures are measured more often.
    results = results | {name: {key: card for key, card in results.get(name, {}).items() if key == CARDS} | found}
    write_bytes(output, (json.dumps(results, indent=1) + "\n").encode())
    click.echo(table(results))
    for source, slope in PUBLISHED.items():
        click.echo(f"{source}: slope {slope}")


if __name__ == "__main__":
    main()
