"""A home with objects, for use by itself: place more of them, look at it, listen to it, write it to a file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from avs3d_bench.geometry import Intrinsics, Pose
from generators.acoustics.geometry import AcousticMesh, acoustic_mesh
from generators.acoustics.rooms import Room as SoundRoom
from generators.assets.model import Model
from generators.core.freespace import SENSOR_HEIGHT
from generators.core.scene import Room, Scene, SupportKind
from generators.core.seeds import random_numbers
from generators.options import Audio
from generators.paths.trajectory import WalkTask, plan_walk
from generators.placement.placement import RULES, Placement, Rule, place
from generators.placement.site import Site
from generators.scenes.placed import PlacedScene
from generators.scenes.renderer import Renderer
from generators.scenes.showing import show
from generators.scenes.sound import HeardSound, hear
from generators.scenes.viewpoints import largest, view_of_object, view_of_room
from generators.vision.base import RenderedView
from generators.vision.glb import write_glb


class HomeScene(PlacedScene):
    """A home with objects that stand still; it is lit when its light is first asked for.

    Args:
        home: lit, without the objects.
        placements: the objects; instance ids count from 1.

    Attributes:
        placements: the objects; instance n is number n − 1.

    Examples:
        >>> home = Home.from_scan("room.glb", rooms={"kitchen": [[0, 0, 0], [4, 2.6, 3.6]]})
        >>> scene = home.place([objects.build("microwave", seed=3), objects.build("oven", seed=1)], rng=1)
        >>> scene
        <HomeScene room: kitchen; 1: microwave/black in the kitchen; 2: oven/steel in the kitchen>
        >>> pose = scene.look_at(1)
        >>> scene.hear(pose, sounding=1, seconds=1, audio="analytic")
        <HeardSound 1 s at 44100 Hz, RMS left -34 dBFS, right -34 dBFS>
    """

    def __init__(self, home: Scene, placements: Sequence[Placement] = ()) -> None:
        super().__init__(home, placements)
        self._sites: dict[str, Site] = {}

    def __repr__(self) -> str:
        rooms = ", ".join(room.name for room in self.rooms)
        placed = (f"{number}: {each.model.name} in the {each.support.room}" for number, each in self._numbered())
        return f"<{type(self).__name__} {self.name}: {rooms}; {'; '.join(placed) or 'no objects placed'}>"

    @property
    def name(self) -> str:
        """Name of the home."""
        return self._home.name

    @property
    def rooms(self) -> tuple[Room, ...]:
        """The rooms, with their inner boxes in metres."""
        return self._home.rooms

    def room(self, name: str) -> Room:
        """The room called ``name``.

        Raises:
            Avs3dError: if there is none; the line names the nearest.
        """
        return self._home.room(name)

    def site(self, room: str) -> Site:
        """A room, measured without the placed objects: its free floor, doors and supports."""
        if room not in self._sites:
            self._sites[room] = Site.of(self._home, room)
        return self._sites[room]

    def place(
        self,
        objects: Model | Sequence[Model],
        *,
        on: SupportKind | Sequence[SupportKind] | None = None,
        room: str | None = None,
        rng: Generator | int = 0,
    ) -> HomeScene:
        """Place objects beside those that are there; this scene stays as it is.

        The place is one that fits: in contact with its support, free of collisions, not in the way, in sight from the
        free floor, at random among those (`generators.placement.placement.place`). Several objects in one call are
        placed in an order that prefers none; a model that is listed twice is placed twice.

        Args:
            objects: one or several, of `generators.objects`.
            on: kind of support (floor, worktop, side_table, shelf, wall), or several in the order of preference; None:
                what is usual for the category.
            room: name of the room; may be left out where the home has one room only.
            rng: random numbers, or their seed.

        Returns:
            The scene with the objects; the first new one has the instance id ``len(self.placements) + 1``.

        Raises:
            UsageError: for an unknown support, or what is no object.
            Avs3dError: if there is no such room, or no place.
        """
        models = checked_models(objects)
        name = self._room_for(room)
        there = [placed for placed in self.placements if placed.support.room == name]
        found = place(
            self.site(name),
            models,
            rng=random_numbers(rng),
            rules=rules_with(models, checked_supports(on)),
            there=there,
        )
        scene = HomeScene(self._home, (*self.placements, *found))
        scene._sites = self._sites
        return scene

    def _room_for(self, name: str | None) -> str:
        if name is None and len(self.rooms) == 1:
            return self.rooms[0].name
        if name is None:
            raise UsageError(f"{self.name}: name the room, room=…: {', '.join(room.name for room in self.rooms)}")
        return self.room(name).name

    def acoustic_mesh(self, sounding: int | None = None) -> AcousticMesh:
        """What sound meets at time 0: welded triangles, each with the label of its acoustic material.

        Args:
            sounding: the instance that sounds, whose own body is left out, as in datasets; None: all bodies are there.

        Returns:
            vertices (V, 3) float64 metres and faces by label; as arrays ``triangles`` (A, 3, 3) and ``labels`` (A,).

        Raises:
            UsageError: if no object has that id.
        """
        source = (math.inf,) * 3 if sounding is None else self.placement(sounding).source_position
        return acoustic_mesh(self.acoustic_scene, source)

    def acoustics(self, sounding: int | None = None) -> SoundRoom:
        """The same as a room of `generators.acoustics`, whose engines give responses and moving sounds in it.

        Args:
            sounding: as for `acoustic_mesh`.

        Raises:
            UsageError: if no object has that id.

        Examples:
            >>> home = Home.from_scan("room.glb", rooms={"kitchen": [[0, 0, 0], [4, 2.6, 3.6]]})
            >>> scene = home.place(objects.build("microwave", seed=3), rng=1)
            >>> room = scene.acoustics(sounding=1)
            >>> engine = acoustics.Analytic()
            >>> engine.response(room, scene.placement(1).source_position, scene.look_at(1)).samples.shape[0]
            2
        """
        mesh = self.acoustic_mesh(sounding)
        return SoundRoom(self.acoustic_scene.name, mesh.triangles.astype(np.float64), tuple(mesh.labels))

    def hear(
        self,
        listener: Pose,
        sounding: int = 1,
        signal: NDArray[np.floating] | None = None,
        *,
        seconds: int = 3,
        audio: Audio | None = None,
        rng: Generator | int = 0,
    ) -> HeardSound:
        """What two ears at ``listener`` hear of a placed object; see `generators.scenes.sound.hear`.

        Args:
            listener: position (m) and orientation of the head.
            sounding: id of the object.
            signal: (n,) mono at 44,100 Hz; None: the synthesised sound of the object's category.
            seconds: length of the synthesised sound.
            audio: tracer, soundspaces or analytic; None: the tracer.
            rng: random numbers of the synthesised sound, or their seed.

        Returns:
            samples (2, n) and response (2, m), float32 at 44,100 Hz; channel 0 is left.

        Raises:
            UsageError: if no object has that id, or the signal is not mono.
            Avs3dError: if the engine is not installed, or listener or source is outside of the home.
        """
        return hear(self, listener, sounding, signal, seconds=seconds, audio=audio, rng=rng)

    def look_at(self, instance: int = 1, *, rng: Generator | int = 0, height: float = SENSOR_HEIGHT) -> Pose:
        """A pose on the free floor from which an object is seen well; see `view_of_object`.

        Args:
            instance: id of the object.
            rng: random numbers, or their seed: another one gives another pose.
            height: of the camera above the floor, metres.

        Raises:
            UsageError: if no object has that id.
            Avs3dError: if no free floor is in sight of it.
        """
        placed = self.placement(instance)
        return view_of_object(self._task(placed.support.room, height=height), placed, random_numbers(rng))

    def walk(self, frames: int = 120, *, room: str | None = None, rng: Generator | int = 0) -> list[Pose]:
        """The poses of an agent that walks through a room and looks at all objects in it, as in datasets.

        Args:
            frames: number of poses, one a second.
            room: name of the room; None: that of the first object.
            rng: random numbers, or their seed.

        Raises:
            Avs3dError: if no object is there, or the free floor is too small.
        """
        name = room or (self.placements[0].support.room if self.placements else None)
        return list(plan_walk(self._task(self._room_for(name), frames=frames), random_numbers(rng)).poses)

    def _task(self, room: str, **further: Any) -> WalkTask:
        there = [placed for placed in self.placements if placed.support.room == room]
        return WalkTask(self.site(room), there, **further)

    def picture(self, size: int = 512) -> RenderedView:
        """A picture of the first object; without objects, of the largest room from the middle of its free floor.

        Args:
            size: side of the picture, pixels.

        Raises:
            Avs3dError: if no free floor is in sight of the object.
        """
        with Renderer(self) as renderer:
            pose = self.look_at(1) if self.placements else view_of_room(self.site(largest(self.rooms)))
            return renderer.frame(pose, Intrinsics.from_fov(size))

    def show(self, size: int = 512) -> None:
        """Show `picture`: below the cell of a notebook; elsewhere as a file, in the viewer of the desktop.

        Args:
            size: side of the picture, pixels.
        """
        show(self.picture(size), self.name)

    def _repr_jpeg_(self) -> bytes:
        return self.picture()._repr_jpeg_()

    def export(self, path: str | Path, *, room: str | None = None, texel: float = 0.005) -> Path:
        """Write the scene as a GLB file with the light in its textures, for Blender, Habitat or a browser.

        Args:
            path: of the file, ``.glb``.
            room: whose exposure the whole file has; None: that of the first object, else of the largest room.
            texel: the finest texel of what has light on it, metres; a file with coarser ones is smaller.

        Returns:
            The path.

        Raises:
            UsageError: if the name does not end in ``.glb``.
            Avs3dError: if there is no such room, ``texel`` is no length, or the file cannot be written.
        """
        target = Path(path)
        if target.suffix.lower() != ".glb":
            raise UsageError(f"export: {target}; expected a name that ends in .glb")
        if room is None:
            room = self.placements[0].support.room if self.placements else largest(self.rooms)
        write_glb(self.scene().for_room(room), target, texel=texel)
        return target


def checked_models(objects: object) -> tuple[Model, ...]:
    """One object or several as a tuple.

    Raises:
        UsageError: for anything else.
    """
    some = isinstance(objects, Sequence) and not isinstance(objects, str)
    given: list[object] = list(objects) if some else [objects]  # type: ignore[call-overload]  # it is a sequence then
    found = tuple(each for each in given if isinstance(each, Model))
    if len(found) < len(given) or not found:
        wrong = next((each for each in given if not isinstance(each, Model)), objects)
        raise UsageError(f'place: found {excerpt(wrong)}; expected an object, e.g. objects.build("microwave"), or some')
    return found


def checked_supports(on: str | Sequence[str] | None) -> tuple[SupportKind, ...]:
    """The kinds of support that a user names, in the order of preference; none: what is usual.

    Raises:
        UsageError: for one that does not exist.
    """
    known = get_args(SupportKind)
    kinds = () if on is None else (on,) if isinstance(on, str) else tuple(on)
    for kind in kinds:
        if kind not in known:
            hint = did_you_mean(kind, known)
            raise UsageError(f"place: unknown support {excerpt(kind)}: expected one of {', '.join(known)}{hint}")
    return kinds  # type: ignore[return-value]  # all are known


def rules_with(models: Sequence[Model], on: tuple[SupportKind, ...]) -> Mapping[str, Rule]:
    """The usual places of the categories, those of ``models`` on the supports ``on`` if there are any."""
    if not on:
        return RULES
    return {**RULES, **{each.category: replace(RULES.get(each.category, Rule()), stands_on=on) for each in models}}
