"""The default renderer against an independent path tracer, Mitsuba 3, in rooms of the open benchmark.

    python -m benchmarks.light_reference -o build/light --name 4.0.0 [--before build/light-before]

Both renderers get the same triangles, materials, lamps, windows and sun, and the same camera poses; radiance is
compared before exposure and tone curve, as the mean over each pixel's square. A pixel counts if all of it shows
surfaces of one kind (`KINDS`: diffuse, glossy, metal, glass) and one class (`CLASSES`: walls, floor, …) that do not
emit. The reference is noisy, so both pictures are averaged over the pixels around each one that show the same plane
(`pooled`). Per room, kind and class the table has the median of the relative difference of luminance, its 90th
percentile, the ratio of the means, and the noise of the reference that is left, from two independent halves of its
paths. Figures are added to docs/results/light-reference.json under ``--name``. Sheets have our picture, with
``--before`` that of an earlier run from the same poses in front of it, the reference, and a map of the difference.

The reference counts all its paths: so does baked light, sunlight by way of a mirror included. `--cut` leaves very
bright paths out (`without_fireflies`); patches of mirrored sunlight consist of such paths.

``--matte`` makes all materials matte and bakes the home again: what is left is matter of the light's transport between
matte surfaces alone.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from avs3d_bench.runtime.one_thread import ONE_THREAD

for _variable, _value in ONE_THREAD.items():
    os.environ.setdefault(_variable, _value)

import click  # noqa: E402
import cv2  # noqa: E402
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from avs3d_bench.errors import Avs3dError  # noqa: E402
from avs3d_bench.formats.files import read_json, write_bytes  # noqa: E402
from avs3d_bench.geometry import Intrinsics, Pose  # noqa: E402
from generators.core.scene import NEUTRAL, Material, Scene  # noqa: E402
from generators.core.tone import develop  # noqa: E402

F32 = NDArray[np.float32]

MANIFEST = Path(__file__).parents[1] / "scenes_manifest" / "open-s34-o7.yaml"
#: Rooms of three homes, of three types; all have sun, the bathroom a narrow patch of it.
OBSERVATIONS = (
    "part_1/apartment_1/living_room/1",
    "part_1/apartment_2/kitchen/2",
    "part_1/apartment_3/bathroom/1",
)
RESULTS = Path(__file__).parents[1] / "docs" / "results" / "light-reference.json"
#: Surface classes in the order of the tables; a face of none of them (it emits, or shows the outdoors) counts nowhere.
CLASSES = ("walls", "floor", "ceiling", "furniture", "objects")
#: Kinds of material in the order of the tables.
KINDS = ("diffuse", "glossy", "metal", "glass")
#: Roughness below which a material is glossy (boards of 0.64 reflect a window seen at a low angle), and shares from
#: which it is metal, glass, or glossy by its clear layer.
GLOSSY_ROUGHNESS, METAL, GLASS, COATED = 0.9, 0.5, 0.1, 0.1
#: Pictures whose mean is the reference, and the most that one of them has over the median of all.
PARTS, MOST_OVER = 8, 3.0
#: Largest median difference that is aimed at, by kind.
AIMS = {"all": 0.08, "diffuse": 0.04}
#: Rays per pixel of our picture along each axis.
OVERSAMPLING = 4
#: Pixels around a pixel, in each direction, that are averaged if they show the same plane.
POOL = 3
#: Two pixels show one plane if the cosine between their normals and the distance of their planes (m) are within these.
SAME_NORMAL, SAME_PLANE = 0.98, 0.02
#: The picture of the documentation: scale and JPEG quality.
DOCS_SCALE, DOCS_QUALITY = 2, 85
#: Side of the pictures from which views are chosen (pixels).
PREVIEW = 48
#: The relative difference at which a map is fully red or fully blue.
MAP_RANGE = 0.25
#: Weights of linear red, green and blue in luminance (ITU-R BT.709).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Agreement:
    """How well two pictures agree on the pixels of one class.

    Attributes:
        pixels: how many there are.
        median: of the relative difference of luminance.
        p90: its 90th percentile.
        ratio: our mean luminance over that of the reference.
        noise: median relative standard error of the reference's pixels, from two independent halves.
    """

    pixels: int
    median: float
    p90: float
    ratio: float
    noise: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """Both pictures of one view.

    Attributes:
        ours: (H, W, 3) our radiance.
        halves: (2, H, W, 3) the reference's radiance from two independent halves of its paths.
        label: (H, W) index into `CLASSES`, −1 for pixels that do not count.
        kind: (H, W) index into `KINDS`.
        plane: (H, W, 4) unit normal and distance from the origin (m) of the plane that the pixel's middle shows.
    """

    ours: F32
    halves: F32
    label: NDArray[np.int8]
    kind: NDArray[np.int8]
    plane: F32

    @property
    def reference(self) -> F32:
        """(H, W, 3) the reference's radiance."""
        return np.asarray(self.halves.mean(axis=0), dtype=np.float32)

    @property
    def difference(self) -> NDArray[np.float64]:
        """(H, W) ours over the reference's luminance, less 1."""
        return luminance(self.ours) / np.maximum(luminance(self.reference), 1e-9) - 1.0


def luminance(radiance: F32) -> NDArray[np.float64]:
    """(…) luminance of (…, 3) radiance."""
    return np.asarray(radiance.astype(np.float64) @ LUMINANCE)


def pooled(view: Comparison, radius: int = POOL) -> Comparison:
    """Average both pictures over the pixels of one class, kind and plane in a square around each pixel.

    The same weights apply to both pictures, so that the average adds no difference of its own.
    """
    height, width = view.label.shape
    pictures = np.concatenate([view.ours[None], view.halves]).astype(np.float64)
    total, number = np.zeros_like(pictures), np.zeros((height, width))
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            here = slice(max(-dy, 0), height - max(dy, 0)), slice(max(-dx, 0), width - max(dx, 0))
            there = slice(max(dy, 0), height - max(-dy, 0)), slice(max(dx, 0), width - max(-dx, 0))
            own, other = view.plane[here], view.plane[there]
            same = (view.label[here] == view.label[there]) & (view.kind[here] == view.kind[there])
            same &= np.einsum("ijk,ijk->ij", own[..., :3], other[..., :3]) > SAME_NORMAL
            same &= np.abs(own[..., 3] - other[..., 3]) < SAME_PLANE
            if dx == dy == 0:
                same[:] = True
            number[here] += same
            total[(slice(None), *here)] += np.where(same[..., None], pictures[(slice(None), *there)], 0.0)
    mean = (total / number[..., None]).astype(np.float32)
    return replace(view, ours=mean[0], halves=mean[1:])


def without_fireflies(parts: F32) -> F32:
    """Halves (2, H, W, 3) of a reference, from pictures (N, H, W, 3) with independent paths, N even.

    Where one of them is brighter than `MOST_OVER` times the median of all, it is darkened to that: where paths are
    few, some very bright ones (the sun by way of two mirrors) hide what is compared. Their light, which baked light
    has, is missing then.
    """
    bright = luminance(parts)
    share = np.minimum(1.0, MOST_OVER * np.median(bright, axis=0) / np.maximum(bright, 1e-9))
    kept = parts * share[..., None]
    return np.asarray(kept.reshape(2, len(parts) // 2, *parts.shape[1:]).mean(axis=1), dtype=np.float32)


def agreement(views: Sequence[Comparison], label: int | None = None, kind: int | None = None) -> Agreement:
    """The figures of one class or kind, or of all that count, over several views."""
    chosen = [view.label >= 0 if label is None else view.label == label for view in views]
    if kind is not None:
        chosen = [own & (view.kind == kind) for own, view in zip(chosen, views, strict=True)]
    error = np.concatenate([np.abs(view.difference[own]) for view, own in zip(views, chosen, strict=True)])
    if not len(error):
        return Agreement(0, float("nan"), float("nan"), float("nan"), float("nan"))
    pairs = list(zip(views, chosen, strict=True))
    ours = np.concatenate([luminance(view.ours[own]) for view, own in pairs])
    theirs = np.concatenate([luminance(view.reference[own]) for view, own in pairs])
    apart = np.concatenate([luminance(view.halves[0][own] - view.halves[1][own]) for view, own in pairs])
    # The mean of two halves has half the standard deviation of their difference; 0.6745 σ is the median of |x|.
    noise = np.median(np.abs(apart) / 2 / np.maximum(theirs, 1e-9)) / 0.6745
    return Agreement(
        len(error),
        float(np.median(error)),
        float(np.quantile(error, 0.9)),
        float(ours.sum() / theirs.sum()),
        float(noise),
    )


def face_labels(scene: Scene) -> NDArray[np.int8]:
    """(F,) index into `CLASSES` of each face of a scene, −1 for faces that emit or show the outdoors."""
    out = []
    for part in scene.parts:
        mesh = part.mesh
        edges = mesh.positions.astype(np.float64)
        normal = np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0])
        up = normal[:, 1] / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
        if part.instance_id > 0:
            label = np.full(len(up), CLASSES.index("objects"))
        elif part.name.startswith("shell_"):
            label = np.where(up > 0.9, CLASSES.index("floor"), np.where(up < -0.9, CLASSES.index("ceiling"), 0))
        else:
            label = np.full(len(up), CLASSES.index("furniture"))
        dark = np.array([max(m.emission) <= 0 and m.shown is None for m in mesh.materials])
        out.append(np.where(dark[mesh.face_material], label, -1))
    return np.concatenate(out).astype(np.int8)


def kind_of(material: Material) -> str:
    """The kind of a material, of `KINDS`."""
    if material.transmission >= GLASS:
        return "glass"
    if material.metallic >= METAL:
        return "metal"
    return "glossy" if material.roughness < GLOSSY_ROUGHNESS or material.clearcoat >= COATED else "diffuse"


def face_kinds(scene: Scene) -> NDArray[np.int8]:
    """(F,) index into `KINDS` of each face of a scene."""
    kinds = [np.array([KINDS.index(kind_of(m)) for m in part.mesh.materials]) for part in scene.parts]
    found = [own[part.mesh.face_material] for own, part in zip(kinds, scene.parts, strict=True)]
    return np.concatenate(found).astype(np.int8)


def our_picture(scene: Scene, pose: Pose, camera: Intrinsics) -> tuple[F32, NDArray[np.int8], NDArray[np.int8], F32]:
    """Our radiance (H, W, 3), and class and kind (H, W) and plane (H, W, 4) of each pixel (see `Comparison`)."""
    from generators.vision.embree import EmbreeBackend

    n = OVERSAMPLING
    fine = replace(
        camera,
        width=camera.width * n,
        height=camera.height * n,
        fx=camera.fx * n,
        fy=camera.fy * n,
        cx=camera.cx * n,
        cy=camera.cy * n,
    )
    session = EmbreeBackend().open(replace(scene, exposure=1.0, white=NEUTRAL), fine)
    radiance, face = session.radiance(pose)
    session.close()
    shape = (camera.height, n, camera.width, n)

    def squares(table: NDArray[np.int8]) -> NDArray[np.int8]:
        found = np.where(face >= 0, table[np.maximum(face, 0)], np.int8(-1)).reshape(shape)
        return np.asarray(found.transpose(0, 2, 1, 3).reshape(camera.height, camera.width, n * n))

    label, kind = squares(face_labels(scene)), squares(face_kinds(scene))
    same = (label == label[..., :1]).all(axis=2) & (kind == kind[..., :1]).all(axis=2)
    # Of a lamp beside a pixel a sliver may lie in its square, between the rays.
    glowing = np.asarray((label < 0).any(axis=2), dtype=np.uint8)
    same &= np.asarray(cv2.dilate(glowing, np.ones((3, 3), dtype=np.uint8))) == 0
    mean = radiance.reshape(*shape, 3).mean(axis=(1, 3), dtype=np.float64)
    middle = np.maximum(face[n // 2 :: n, n // 2 :: n], 0)
    corners = np.concatenate([part.mesh.positions for part in scene.parts])[middle].astype(np.float64)
    normal = np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    offset = np.einsum("ijk,ijk->ij", normal, corners[..., 0, :])
    plane = np.concatenate([normal, offset[..., None]], axis=-1).astype(np.float32)
    return mean.astype(np.float32), np.where(same, label[..., 0], -1).astype(np.int8), kind[..., 0], plane


def compare(
    mi: Any,
    scene: Scene,
    room: str | None,
    poses: Sequence[Pose],
    *,
    size: int,
    samples: int,
    cut: bool = False,
) -> list[Comparison]:
    """Render a lit scene with both renderers.

    Args:
        mi: from `generators.vision.mitsuba_scene.load_mitsuba`.
        scene: with its light.
        room: the room that the poses lie in, None for any.
        poses: of the camera.
        size: of the pictures (pixels); the field of view is 90°.
        samples: paths per pixel of each of `PARTS` pictures that the reference is the mean of.
        cut: leave very bright paths out of the reference (see `without_fireflies`).
    """
    from generators.vision.mitsuba_scene import MitsubaScene

    camera = Intrinsics.from_fov(size)
    reference = MitsubaScene(mi, scene, None if room is None else scene.room(room))
    views = []
    for number, pose in enumerate(poses):
        ours, label, kind, plane = our_picture(scene, pose, camera)
        seeds = range(PARTS * number, PARTS * (number + 1))
        parts = np.stack([reference.render(pose, camera, samples, seed=seed) for seed in seeds])
        halves = without_fireflies(parts) if cut else parts.reshape(2, PARTS // 2, *parts.shape[1:]).mean(axis=1)
        views.append(Comparison(ours, halves, label, kind, plane))
    return views


def wide_views(scene: Scene, poses: Sequence[Pose], count: int) -> list[Pose]:
    """The pose that sees farthest (greatest median depth) in each of ``count`` equal spans of a path.

    A camera that stands before a wall shows little light.
    """
    from generators.vision.embree import EmbreeBackend

    session = EmbreeBackend().open(scene, Intrinsics.from_fov(PREVIEW))
    depth = [float(np.median(session.render(pose).depth)) for pose in poses]
    session.close()
    return [poses[span[int(np.argmax(np.array(depth)[span]))]] for span in np.array_split(np.arange(len(poses)), count)]


def with_matte_materials(scene: Scene) -> Scene:
    """The same lit scene with matte materials of the same colours."""

    def matte(material: Material) -> Material:
        plain = replace(material, roughness=1.0, metallic=0.0, transmission=0.0, clearcoat=0.0)
        return replace(plain, normal_map=None, roughness_map=None)

    parts = []
    for part in scene.parts:
        materials = tuple(matte(material) for material in part.mesh.materials)
        parts.append(replace(part, mesh=replace(part.mesh, materials=materials)))
    return replace(scene, parts=tuple(parts))


def prepared_room(key: str, cache: Path, *, matte: bool) -> tuple[Scene, str, tuple[Pose, ...]]:
    """The lit scene of an observation of the open benchmark with its objects, its room, and its camera poses.

    Raises:
        Avs3dError: if the manifest has no such observation.
    """
    from generators.homes.store import open_home
    from generators.lighting.bake import bake, insert
    from generators.observation.arrangement import arrange
    from generators.options import GenerateOptions
    from generators.plan import make_plans, read_manifest

    plans = {plan.key: plan for plan in make_plans(read_manifest(MANIFEST), GenerateOptions(audio="analytic"))}
    if key not in plans:
        raise Avs3dError(f"{MANIFEST.name}: no observation {key!r}; expected one like {OBSERVATIONS[0]}")
    plan = plans[key]
    home = open_home(plan, cache).for_room(plan.spec.room)
    seen = arrange(plan, home)
    parts = tuple(placed.part(number) for number, placed in enumerate(seen.placements, start=1))
    if matte:
        # What surfaces hand on is baked in: the home is lit again.
        bare = replace(home, parts=tuple(replace(part, light=None) for part in home.parts))
        home = bake(with_matte_materials(bare), quality=plan.light).for_room(plan.spec.room)
        parts = with_matte_materials(replace(home, parts=parts)).parts
    return insert(home, parts), plan.spec.room, seen.poses


def difference_map(view: Comparison) -> NDArray[np.uint8]:
    """(H, W, 3) blue where ours is darker than the reference, white where they agree, red where it is brighter.

    Full colour is a difference of `MAP_RANGE`; pixels that do not count are grey.
    """
    share = np.clip(view.difference / MAP_RANGE, -1.0, 1.0)[..., None]
    red, blue = np.array([178, 24, 43]), np.array([33, 102, 172])
    colour = np.where(share > 0, 255 + share * (red - 255), 255 - share * (blue - 255))
    return np.where((view.label >= 0)[..., None], colour, 128).astype(np.uint8)


def sheet(
    views: Sequence[Comparison], exposure: NDArray[np.float64], before: Sequence[NDArray[np.uint8]] = ()
) -> NDArray[np.uint8]:
    """Rows of our picture (in front of it that of ``before``, if there is one), the reference, and their difference."""
    rows = []
    for number, view in enumerate(views):
        pictures = [*before[number : number + 1], develop(exposure * view.ours), develop(exposure * view.reference)]
        pictures.append(difference_map(pooled(view)))
        framed = [np.pad(picture, ((2, 2), (2, 2), (0, 0)), constant_values=255) for picture in pictures]
        rows.append(np.concatenate(framed, axis=1))
    return np.concatenate(rows, axis=0)


def write_picture(path: Path, rows: Sequence[NDArray[np.uint8]]) -> None:
    """Write sheets, one above the other, enlarged, as a JPEG."""
    picture = np.ascontiguousarray(np.concatenate(rows, axis=0)[..., ::-1])
    large = cv2.resize(picture, None, fx=DOCS_SCALE, fy=DOCS_SCALE, interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(path), large, [cv2.IMWRITE_JPEG_QUALITY, DOCS_QUALITY])


def table(results: dict[str, dict[str, Agreement]]) -> str:
    """The figures as a Markdown table."""
    lines = [
        "| room | surfaces | pixels | median difference | 90th percentile | mean, ours over reference | noise |",
        "|---|---|---|---|---|---|---|",
    ]
    for room, classes in results.items():
        for name, found in classes.items():
            if found.pixels:
                lines.append(
                    f"| {room} | {name} | {found.pixels:,} | {found.median:.1%} | {found.p90:.1%} | "
                    f"{found.ratio:.3f} | {found.noise:.1%} |"
                )
    return "\n".join(lines)


def figures_of(views: Sequence[Comparison]) -> dict[str, Agreement]:
    """The figures of a room: by kind of material, of all that counts, and by class of surface."""
    found = {name: agreement(views, kind=kind) for kind, name in enumerate(KINDS)} | {"all": agreement(views)}
    return found | {name: agreement(views, label) for label, name in enumerate(CLASSES)}


def overall(rooms: Sequence[Sequence[Comparison]]) -> dict[str, float]:
    """Median difference over all rooms, by kind, and of all that counts; only of what was seen."""
    found = figures_of([view for views in rooms for view in views])
    return {name: found[name].median for name in (*KINDS, "all") if found[name].pixels}


@dataclass(frozen=True, eq=False)
class Earlier:
    """An earlier run in a room: its camera poses, and its pictures (N, H, W, 3), developed."""

    poses: tuple[Pose, ...]
    pictures: NDArray[np.uint8]


def save(path: Path, views: Sequence[Comparison], poses: Sequence[Pose], exposure: NDArray[np.float64]) -> None:
    """Keep the radiance of both pictures of a room's views, and what `load_earlier` reads."""
    np.savez_compressed(
        path,
        shown=np.stack([develop(exposure * view.ours) for view in views]),
        camera=np.array([[*pose.position, *pose.rotation] for pose in poses]),
        ours=np.stack([view.ours for view in views]),
        halves=np.stack([view.halves for view in views]),
        label=np.stack([view.label for view in views]),
        kind=np.stack([view.kind for view in views]),
    )


def load_earlier(path: Path) -> Earlier:
    """What an earlier run has saved of a room.

    Raises:
        Avs3dError: if it has saved nothing of this room.
    """
    if not path.exists():
        raise Avs3dError(f"{path}: no such file; expected the folder of an earlier run with the same observations")
    with np.load(path) as kept:
        poses = tuple(Pose(tuple(row[:3]), tuple(row[3:])) for row in kept["camera"].tolist())
        return Earlier(poses, kept["shown"])


@click.command()
@click.argument("observations", nargs=-1)
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="Folder of the pictures.")
@click.option("--name", required=True, help="Of the figures: the version of the pictures.")
@click.option("--json", "record", type=click.Path(path_type=Path), default=RESULTS, show_default="docs/results")
@click.option("--before", type=click.Path(exists=True, path_type=Path), help="Folder of an earlier run.")
@click.option("--views", type=click.IntRange(1, 120), default=2, show_default=True, help="Frames of each observation.")
@click.option("--size", type=click.IntRange(16), default=128, show_default=True, help="Side of the pictures (pixels).")
@click.option("--spp", type=click.IntRange(2), default=384, show_default=True, help="Paths per pixel.")
@click.option("--matte", is_flag=True, help="Make all materials matte.")
@click.option("--cut", is_flag=True, help="Leave very bright paths out of the reference.")
@click.option("--variant", help="Variant of Mitsuba; the first of llvm_ad_rgb and scalar_rgb that works if missing.")
@click.option("--cache", type=click.Path(path_type=Path), help="Folder of baked homes.")
def main(
    observations: tuple[str, ...],
    output: Path,
    name: str,
    record: Path,
    before: Path | None,
    views: int,
    size: int,
    spp: int,
    matte: bool,
    cut: bool,
    variant: str | None,
    cache: Path | None,
) -> None:
    """Compare the default renderer with path tracing in OBSERVATIONS of the open benchmark."""
    from generators.core.folders import default_cache
    from generators.vision.mitsuba_scene import load_mitsuba

    try:
        mi = load_mitsuba(*([variant] if variant else []))
        output.mkdir(parents=True, exist_ok=True)
        rooms: dict[str, list[Comparison]] = {}
        rows = []
        for key in observations or OBSERVATIONS:
            started = time.process_time()
            file = key.replace("/", "-")
            earlier = None if before is None else load_earlier(before / f"{file}.npz")
            scene, room, poses = prepared_room(key, cache or default_cache(), matte=matte)
            chosen = wide_views(scene, poses, views) if earlier is None else earlier.poses
            found = compare(mi, scene, room, chosen, size=size, samples=max(1, spp // PARTS), cut=cut)
            save(output / f"{file}.npz", found, chosen, scene.gains)
            rooms[key] = [pooled(view) for view in found]
            picture = sheet(found, scene.gains, () if earlier is None else tuple(earlier.pictures))
            rows.append(picture[: len(picture) // len(found)])
            cv2.imwrite(str(output / f"{file}.png"), np.ascontiguousarray(picture[..., ::-1]))
            click.echo(f"{key}: {time.process_time() - started:.0f} s CPU", err=True)
        write_picture(output / "light-reference.jpg", rows)
    except Avs3dError as error:
        raise click.ClickException(str(error)) from error
    results = {key: figures_of(found) for key, found in rooms.items()}
    whole = overall(list(rooms.values()))
    figures = {
        "mitsuba": mi.__version__, "variant": mi.variant(), "size": size, "spp": spp, "matte": matte,
        "all_paths": not cut, "median": whole,
        "rooms": {key: {kind: asdict(one) for kind, one in own.items() if one.pixels} for key, own in results.items()},
    }  # fmt: skip
    known = read_json(record) if record.exists() else {}
    write_bytes(record, (json.dumps(known | {name: figures}, indent=1) + "\n").encode())
    click.echo(table(results))
    for kind, median in whole.items():
        aim = "" if kind not in AIMS else f" (aim ≤ {AIMS[kind]:.0%}: {'met' if median <= AIMS[kind] else 'MISSED'})"
        click.echo(f"{kind}: {median:.1%}{aim}")


if __name__ == "__main__":
    main()
