"""A home by itself: a procedural flat from a seed, or a scan from a file, to place objects in and to look at.

    from avs3d_bench.geometry import Intrinsics
    from generators import Home, Renderer, objects

    home = Home.apartment(seed=7)
    scene = home.place(objects.build("microwave", seed=3), on="worktop", room="kitchen", rng=1)
    frame = Renderer(scene).frame(scene.look_at(1), Intrinsics.from_fov(512))

What makes a dataset calls the same functions below this one: `generators.homes.store` opens a home,
`generators.placement.placement.place` finds places, `generators.scenes` lights and draws the result.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

from numpy.typing import ArrayLike

from avs3d_bench.errors import Avs3dError, UsageError, did_you_mean, excerpt
from generators.core.cuda import cuda_version
from generators.core.folders import default_cache
from generators.core.scene import Licence, Scene
from generators.homes.store import lit_apartment
from generators.lighting.bake import QUALITIES
from generators.manifest.schema import ScanSpec
from generators.options import Device
from generators.plan import home_digest
from generators.scans.files import scan_files_of
from generators.scans.scan import Axes, load_scan
from generators.scenes.home_scene import HomeScene
from generators.surveying.run import find_rooms
from generators.surveying.survey import KnownFrame


class Home(HomeScene):
    """A home in which nothing is placed yet; `place` gives a scene with objects.

    Args:
        scene: the home with its light, as `Home.apartment` and `Home.from_scan` make it.

    Examples:
        >>> home = Home.from_scan("room.glb", rooms={"kitchen": [[0, 0, 0], [4, 2.6, 3.6]]})
        >>> home
        <Home room: kitchen; no objects placed>
        >>> home.room("kitchen").high  # metres, Y up
        (4.0, 2.6, 3.6)
        >>> home.place(objects.build("microwave", seed=3), on="worktop", rng=1)
        <HomeScene room: kitchen; 1: microwave/black in the kitchen>
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)

    @classmethod
    def apartment(
        cls,
        seed: int,
        *,
        name: str | None = None,
        light: str = "standard",
        device: str = "cpu",
        cache: str | Path | None = None,
        workers: int | None = None,
    ) -> Home:
        """A furnished and lit flat; the same seed gives the same bytes.

        Building and lighting takes half a minute of CPU time at ``standard``, some seconds at ``preview``; the result
        is kept in ``cache``, where datasets find it, too.

        Args:
            seed: decides everything, 0 or more.
            name: of the flat, which the direction of the sun is drawn from; None: ``home_<seed>``, as in manifests
                that `avs3d manifest sample` writes.
            light: quality of the baked light: preview, standard or high.
            device: what bakes it: ``cpu``, or ``cuda``, whose light differs by rounding.
            cache: folder of lit homes; None: ``$AVS3D_CACHE``, or the user's cache folder.
            workers: threads; None: one for each core. The flat does not depend on them.

        Raises:
            UsageError: if the seed is no whole number of 0 or more, or there is no such quality or device.
            Avs3dError: if the cache cannot be written, or CUDA cannot be used.
        """
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            raise UsageError(f"Home.apartment: seed {excerpt(seed)}; expected a whole number of 0 or more")
        if light not in QUALITIES:
            hint = did_you_mean(light, QUALITIES)
            raise UsageError(f"Home.apartment: light {excerpt(light)}; expected one of {', '.join(QUALITIES)}{hint}")
        if device not in get_args(Device):
            known = ", ".join(get_args(Device))
            raise UsageError(f"Home.apartment: device {excerpt(device)}; expected one of {known}")
        label = name or f"home_{seed}"
        of_device = () if device == "cpu" else (cuda_version(),)
        key = home_digest(label, ScanSpec(source="apartment", seed=seed), light, *of_device)
        folder = default_cache() if cache is None else Path(cache)
        threads = workers or os.cpu_count() or 1
        return cls(lit_apartment(label, seed, light, folder, key=key, device=device, workers=threads))

    @classmethod
    def from_scan(
        cls,
        path: str | Path,
        rooms: Mapping[str, ArrayLike] | None = None,
        *,
        name: str | None = None,
        axes: Axes | None = None,
        licence: Licence | None = None,
    ) -> Home:
        """A scan of rooms: HM3D, Matterport3D, a phone's scan, any GLB, glTF, OBJ or PLY.

        Args:
            path: of its mesh.
            rooms: name of each room → its box (2, 3): lowest and highest corner, metres, Y up, after ``axes``; None:
                they are taken from the scan's annotations or, where it has none, looked for, and named by their size:
                living_room, kitchen, bathroom.
            name: of the scan; None: that of the file.
            axes: which axes of the file point up and to the front, and its unit; None: as its data set has them or,
                without ``rooms``, as they are found.
            licence: of the scan.

        Raises:
            UsageError: if ``rooms`` are no boxes by name.
            Avs3dError: if the file is missing or no mesh, or has no room; or a box holds no floor.
        """
        file = Path(path)
        label = name or file.name.partition(".")[0]
        if not file.is_file():
            what = "is a folder" if file.is_dir() else "does not exist"
            raise Avs3dError(f"{file}: {what}; expected a mesh: .glb, .gltf, .obj or .ply")
        if rooms is not None and not isinstance(rooms, Mapping):
            raise UsageError(
                f'Home.from_scan: rooms {excerpt(rooms)}; expected boxes by name, e.g. {{"kitchen": [[0, 0, 0], '
                "[4, 2.5, 3]]}, lowest and highest corner in metres"
            )
        files = scan_files_of(file.resolve())
        if rooms is None and files.kind == "file":
            known = KnownFrame(axes.up, axes.front, axes.scale) if axes else None
            axes, rooms = find_rooms(file, known)
        return cls(load_scan(label, files, rooms, licence=licence, axes=axes or Axes()))
