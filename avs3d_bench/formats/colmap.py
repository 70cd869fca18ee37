"""COLMAP's binary sparse model: `cameras.bin`, `images.bin`, `points3D.bin`, written and read with numpy alone.

Format: https://colmap.github.io/format.html#binary-file-format, little endian. pycolmap reads the same files (a test
holds it); it is not used here, because reading a dataset must not need it.

In memory everything is in our conventions (Y up, cameras look down −Z); the files hold OpenCV cameras in a world with
Y down (see `avs3d_bench.geometry`). Pixel (0.5, 0.5) is the centre of the first pixel, here and there.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.files import read_bytes, write_bytes
from avs3d_bench.geometry import Intrinsics, Pose, flip_world, from_colmap, to_colmap

_PINHOLE = 1
#: COLMAP's camera models: id → (name, where fx, fy, cx, cy stand, number of parameters).
_MODELS = {
    0: ("SIMPLE_PINHOLE", (0, 0, 1, 2), 3),
    1: ("PINHOLE", (0, 1, 2, 3), 4),
    2: ("SIMPLE_RADIAL", (0, 0, 1, 2), 4),
    3: ("RADIAL", (0, 0, 1, 2), 5),
    4: ("OPENCV", (0, 1, 2, 3), 8),
}
_POINT2D = np.dtype([("xy", "<f8", (2,)), ("point", "<i8")])
_TRACK = np.dtype([("image", "<i4"), ("index", "<i4")])


@dataclass(frozen=True, eq=False)
class ColmapImage:
    """A registered image.

    Attributes:
        id: from 1 on.
        name: file name in `images/`, e.g. ``frame_000.png``.
        camera: id of its camera.
        pose: camera-to-world, our convention.
        pixels: (P, 2) float64 (column, row) of its 2D points.
        point_ids: (P,) int64 ids of the 3D points they show; −1 where none.
    """

    id: int
    name: str
    camera: int
    pose: Pose
    pixels: NDArray[np.float64]
    point_ids: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ColmapPoints:
    """3D points with their tracks; the track of point i is ``track_*[offsets[i] : offsets[i + 1]]``.

    Attributes:
        ids: (N,) int64, ascending.
        positions: (N, 3) float64, metres, Y up.
        colours: (N, 3) uint8.
        errors: (N,) float64 mean reprojection error, pixels.
        offsets: (N + 1,) int64.
        track_image: (T,) int32 image ids.
        track_index: (T,) int32 index into that image's 2D points.
    """

    ids: NDArray[np.int64]
    positions: NDArray[np.float64]
    colours: NDArray[np.uint8]
    errors: NDArray[np.float64]
    offsets: NDArray[np.int64]
    track_image: NDArray[np.int32]
    track_index: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class ColmapModel:
    """A sparse reconstruction: cameras by id, images in ascending id, points."""

    cameras: Mapping[int, Intrinsics]
    images: tuple[ColmapImage, ...]
    points: ColmapPoints

    @classmethod
    def from_poses(
        cls,
        intrinsics: Intrinsics,
        names: Sequence[str],
        poses: Sequence[Pose],
        positions: ArrayLike,
        colours: ArrayLike,
        track_point: ArrayLike,
        track_frame: ArrayLike,
        track_pixel: ArrayLike,
    ) -> ColmapModel:
        """A model from true poses and surface points.

        Ids count from 1: image k + 1 is ``names[k]``, point i + 1 is ``positions[i]``. A track element whose pixel is
        not where the point projects shows up in the point's error.

        Args:
            intrinsics: the one camera.
            names: file names of the images, in order.
            poses: one per name, camera-to-world.
            positions: (N, 3) world, Y up.
            colours: (N, 3) uint8.
            track_point: (T,) index of the point of each sighting.
            track_frame: (T,) index of the frame that sees it.
            track_pixel: (T, 2) (column, row) there.

        Raises:
            Avs3dError: if lengths or indices do not fit together.
        """
        where = "sparse model"
        xyz = np.asarray(positions, dtype=np.float64).reshape(-1, 3)
        rgb = np.asarray(colours, dtype=np.uint8).reshape(-1, 3)
        point = np.asarray(track_point, dtype=np.int64).reshape(-1)
        frame = np.asarray(track_frame, dtype=np.int64).reshape(-1)
        pixel = np.asarray(track_pixel, dtype=np.float64).reshape(-1, 2)
        if len(names) != len(poses) or len(xyz) != len(rgb) or not len(point) == len(frame) == len(pixel):
            raise Avs3dError(
                f"{where}: {len(names)} names for {len(poses)} poses, {len(xyz)} points with {len(rgb)} colours, "
                f"tracks of {len(point)}, {len(frame)}, {len(pixel)} sightings; expected equal lengths"
            )
        for index, limit, what in ((point, len(xyz), "point"), (frame, len(poses), "frame")):
            if index.size and (index.min() < 0 or index.max() >= limit):
                raise Avs3dError(f"{where}: a track names {what} {int(index.max())} of {limit}")
        order = np.lexsort((frame, point))
        point, frame, pixel = point[order], frame[order], pixel[order]
        images: list[ColmapImage] = []
        slot = np.zeros(len(point), dtype=np.int32)
        error = np.zeros(len(point))
        for number, (name, pose) in enumerate(zip(names, poses, strict=True)):
            mine = np.flatnonzero(frame == number)
            slot[mine] = np.arange(len(mine), dtype=np.int32)
            projected, _ = intrinsics.project(pose, xyz[point[mine]])
            error[mine] = np.linalg.norm(projected - pixel[mine], axis=1)
            images.append(ColmapImage(number + 1, name, 1, pose, pixel[mine], point[mine] + 1))
        count = np.bincount(point, minlength=len(xyz))
        total = np.bincount(point, weights=error, minlength=len(xyz))
        points = ColmapPoints(
            ids=np.arange(1, len(xyz) + 1, dtype=np.int64),
            positions=xyz,
            colours=rgb,
            errors=total / np.maximum(count, 1),
            offsets=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
            track_image=(frame + 1).astype(np.int32),
            track_index=slot,
        )
        return cls({1: intrinsics}, tuple(images), points)

    def reprojection_errors(self) -> NDArray[np.float64]:
        """(T,) pixels between each sighting and the projection of its point; infinite behind the camera."""
        by_id = {image.id: image for image in self.images}
        owner = np.repeat(np.arange(len(self.points.ids)), np.diff(self.points.offsets))
        out = np.full(len(owner), np.inf)
        for image_id in np.unique(self.points.track_image):
            image = by_id.get(int(image_id))
            mine = np.flatnonzero(self.points.track_image == image_id)
            slots = self.points.track_index[mine]
            if image is None or slots.min() < 0 or slots.max() >= len(image.pixels):
                raise Avs3dError(f"sparse model: a track names image {image_id} or a 2D point that does not exist")
            projected, _ = self.cameras[image.camera].project(image.pose, self.points.positions[owner[mine]])
            distance = np.linalg.norm(projected - image.pixels[slots], axis=1)
            out[mine] = np.where(np.isfinite(distance), distance, np.inf)
        return out


def write_model(folder: str | Path, model: ColmapModel) -> None:
    """Write the three files into ``folder``, each atomically.

    Raises:
        Avs3dError: if the system refuses.
    """
    for name, data in encode_model(model).items():
        write_bytes(Path(folder) / name, data)


def encode_model(model: ColmapModel) -> dict[str, bytes]:
    """Name → bytes of the three files of a model."""
    cameras = [struct.pack("<Q", len(model.cameras))]
    for camera_id, k in sorted(model.cameras.items()):
        cameras.append(struct.pack("<iiQQ4d", camera_id, _PINHOLE, k.width, k.height, k.fx, k.fy, k.cx, k.cy))

    images = [struct.pack("<Q", len(model.images))]
    for image in model.images:
        qvec, tvec = to_colmap(image.pose)
        images.append(struct.pack("<i7di", image.id, *qvec, *tvec, image.camera))
        images.append(image.name.encode() + b"\0" + struct.pack("<Q", len(image.pixels)))
        table = np.empty(len(image.pixels), dtype=_POINT2D)
        table["xy"], table["point"] = image.pixels, image.point_ids
        images.append(table.tobytes())

    p = model.points
    track = np.empty(len(p.track_image), dtype=_TRACK)
    track["image"], track["index"] = p.track_image, p.track_index
    sightings = track.tobytes()
    points = [struct.pack("<Q", len(p.ids))]
    for i, (xyz, rgb) in enumerate(zip(flip_world(p.positions).tolist(), p.colours.tolist(), strict=True)):
        first, last = int(p.offsets[i]), int(p.offsets[i + 1])
        points.append(struct.pack("<q3d3BdQ", int(p.ids[i]), *xyz, *rgb, float(p.errors[i]), last - first))
        points.append(sightings[first * _TRACK.itemsize : last * _TRACK.itemsize])
    return {
        "cameras.bin": b"".join(cameras),
        "images.bin": b"".join(images),
        "points3D.bin": b"".join(points),
    }


class _Cursor:
    """Reads forward through a file's bytes and notices where they end too soon."""

    def __init__(self, path: Path) -> None:
        self.path, self.data, self.at = path, read_bytes(path), 0

    def take(self, size: int) -> int:
        start, self.at = self.at, self.at + size
        if self.at > len(self.data):
            raise Avs3dError(f"{self.path}: truncated: {len(self.data)} bytes, expected more; regenerate it")
        return start

    def unpack(self, form: str) -> tuple[int | float, ...]:
        return struct.unpack_from(form, self.data, self.take(struct.calcsize(form)))

    def count(self) -> int:
        (number,) = struct.unpack_from("<Q", self.data, self.take(8))
        return int(number)

    def table(self, dtype: np.dtype[np.void], rows: int) -> NDArray[np.void]:
        return np.frombuffer(self.data, dtype=dtype, count=rows, offset=self.take(dtype.itemsize * rows))

    def text(self) -> str:
        stop = self.data.find(b"\0", self.at)
        if stop < 0:
            raise Avs3dError(f"{self.path}: truncated inside a name; regenerate it")
        start = self.take(stop + 1 - self.at)
        return self.data[start:stop].decode("utf-8", "replace")

    def done(self) -> None:
        if self.at != len(self.data):
            raise Avs3dError(f"{self.path}: {len(self.data) - self.at} bytes too many; regenerate it")


def read_cameras(path: str | Path) -> dict[int, Intrinsics]:
    """Read `cameras.bin`.

    Raises:
        Avs3dError: if it is missing or damaged, or a camera has lens distortion.
    """
    cursor = _Cursor(Path(path))
    cameras: dict[int, Intrinsics] = {}
    for _ in range(cursor.count()):
        camera_id, model_id, width, height = cursor.unpack("<iiQQ")
        if model_id not in _MODELS:
            raise Avs3dError(f"{path}: camera model {model_id}, expected PINHOLE: undistort the images (COLMAP)")
        name, places, size = _MODELS[int(model_id)]
        parameters = cursor.unpack(f"<{size}d")
        if any(parameters[max(places) + 1 :]):
            raise Avs3dError(f"{path}: camera {name} with lens distortion, expected PINHOLE: undistort the images")
        fx, fy, cx, cy = (float(parameters[place]) for place in places)
        if not (width > 0 and height > 0 and fx > 0 and fy > 0 and np.isfinite([fx, fy, cx, cy]).all()):
            raise Avs3dError(f"{path}: camera {camera_id} has parameters {parameters}: expected finite, positive ones")
        cameras[int(camera_id)] = Intrinsics(int(width), int(height), fx, fy, cx, cy)
    cursor.done()
    return cameras


def read_images(path: str | Path) -> tuple[ColmapImage, ...]:
    """Read `images.bin`, in ascending id.

    Raises:
        Avs3dError: if it is missing or damaged.
    """
    cursor = _Cursor(Path(path))
    images: list[ColmapImage] = []
    for _ in range(cursor.count()):
        image_id, *numbers, camera = cursor.unpack("<i7di")
        name = cursor.text()
        table = cursor.table(_POINT2D, cursor.count())
        try:
            pose = from_colmap(numbers[:4], numbers[4:])
        except Avs3dError as error:
            raise Avs3dError(f"{path}: image {image_id}: {error}") from None
        images.append(
            ColmapImage(int(image_id), name, int(camera), pose, table["xy"].copy(), table["point"].astype(np.int64))
        )
    cursor.done()
    return tuple(sorted(images, key=lambda image: image.id))


def read_points(path: str | Path) -> ColmapPoints:
    """Read `points3D.bin`, in ascending id.

    Raises:
        Avs3dError: if it is missing or damaged.
    """
    cursor = _Cursor(Path(path))
    rows: list[tuple[int, tuple[float, ...], tuple[int, ...], float, bytes]] = []
    for _ in range(cursor.count()):
        number, x, y, z, r, g, b, error = cursor.unpack("<q3d3Bd")
        start = cursor.take(cursor.count() * _TRACK.itemsize)
        rows.append((int(number), (x, y, z), (int(r), int(g), int(b)), error, cursor.data[start : cursor.at]))
    cursor.done()
    rows.sort(key=lambda row: row[0])
    tracks = np.frombuffer(b"".join(row[4] for row in rows), dtype=_TRACK)
    lengths = [len(row[4]) // _TRACK.itemsize for row in rows]
    return ColmapPoints(
        ids=np.array([row[0] for row in rows], dtype=np.int64),
        positions=flip_world(np.array([row[1] for row in rows], dtype=np.float64).reshape(-1, 3)),
        colours=np.array([row[2] for row in rows], dtype=np.uint8).reshape(-1, 3),
        errors=np.array([row[3] for row in rows], dtype=np.float64),
        offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        track_image=tracks["image"].astype(np.int32),
        track_index=tracks["index"].astype(np.int32),
    )


def read_model(folder: str | Path) -> ColmapModel:
    """Read the three files of ``folder``.

    Raises:
        Avs3dError: naming the file that is missing or damaged, or an image without a camera.
    """
    base = Path(folder)
    cameras, images = read_cameras(base / "cameras.bin"), read_images(base / "images.bin")
    for image in images:
        if image.camera not in cameras:
            raise Avs3dError(f"{base / 'images.bin'}: image {image.name} names camera {image.camera}, which is missing")
    return ColmapModel(cameras, images, read_points(base / "points3D.bin"))
