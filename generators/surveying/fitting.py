"""Which observations a surveyed scan has room for: their objects are placed and their walks planned, as later.

Nothing is guessed from sizes: an observation goes into the manifest if `arrange` finds places and a walk for it under
the very key and seed that it will have there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from avs3d_bench.errors import Avs3dError
from generators.core.scene import Scene
from generators.manifest.reading import ManifestFile
from generators.manifest.schema import Manifest
from generators.observation.arrangement import arrange
from generators.options import GenerateOptions
from generators.placement.site import Site
from generators.plan import make_plans
from generators.sampling.rooms import MOST

#: Of a scan with one room, which other rooms' objects may be in it.
ONE_ROOM = ("living_room", "kitchen")
#: Largest numbers of observations of part_1 and part_2: of the only room, of each of several.
MOST_OF_ONE_ROOM, MOST_OF_EACH = (4, 3), (2, 2)
#: Numbers of instances that are tried in part_2.
COPIES = (3, 2)
#: Indices that are tried for several objects: places and walk are drawn by the key, and may fit under another one.
TRIES = 3


@dataclass(frozen=True, eq=False)
class FittingObservations:
    """Observations as entries of a manifest; ``refused``: ``room: category`` → why none of it fits."""

    entries: tuple[dict[str, Any], ...]
    refused: dict[str, str]

    @property
    def categories(self) -> tuple[str, ...]:
        """All categories that sound."""
        named = [str(entry.get("category") or "") for entry in self.entries]
        return tuple(dict.fromkeys(name for name in named if name))


@dataclass(eq=False)
class ScanFitting:
    """Tries observations in the rooms of a scan.

    Attributes:
        home: the scan as it is loaded later.
        document: the manifest without its observations.
        base: folder of the manifest.
    """

    home: Scene
    document: dict[str, Any]
    base: Path
    _sites: dict[str, Site] = field(default_factory=dict)

    def site(self, room: str) -> Site:
        """The measured room."""
        if room not in self._sites:
            self._sites[room] = Site.of(self.home, room)
        return self._sites[room]

    def fault(self, entry: dict[str, Any]) -> str:
        """Why an observation does not fit; "" if it fits."""
        manifest = Manifest.model_validate(self.document | {"observations": [entry]})
        (plan,) = make_plans(
            ManifestFile(manifest, self.base / "manifest.yaml", "", ""), GenerateOptions(audio="analytic")
        )
        try:
            arrange(plan, self.home, site=self.site(plan.spec.room))
        except Avs3dError as error:
            return str(error)
        return ""

    def observations(self, rooms: Sequence[str]) -> FittingObservations:
        """Observations of all parts for the rooms, as many as fit up to the usual numbers."""
        (scan,) = self.document["scans"]
        entries: list[dict[str, Any]] = []
        refused: dict[str, str] = {}
        for room in rooms:
            place = {"scan": scan, "room": room}
            names = [name for kind in (ONE_ROOM if len(rooms) == 1 else (room,)) for name in MOST[kind]]
            most_single, most_several = MOST_OF_ONE_ROOM if len(rooms) == 1 else MOST_OF_EACH
            single = self._single(place, list(dict.fromkeys(names)), most_single, refused)
            entries += single
            entries += self._several(place, [entry["category"] for entry in single], most_several)
        order = {"part_1": 0, "part_2": 1, "part_3": 2}
        entries.sort(key=lambda entry: order[entry["part"]])
        return FittingObservations((*entries, *self._siblings(entries)), refused)

    def _single(
        self, place: dict[str, Any], names: Sequence[str], most: int, refused: dict[str, str]
    ) -> list[dict[str, Any]]:
        """One object that sounds and, where it fits, another one that does not."""
        found: list[dict[str, Any]] = []
        for name in names:
            if len(found) == most:
                break
            entry = {"part": "part_1", **place, "index": len(found) + 1, "category": name}
            beside = [{**entry, "silent": [other["category"]]} for other in found[-1:]]
            fault = ""
            for candidate in (*beside, entry):
                fault = self.fault(candidate)
                if not fault:
                    found.append(candidate)
                    break
            if fault:
                refused[f"{place['room']}: {name}"] = fault.removeprefix(f"{place['scan']}/{place['room']}: ")
        return found

    def _several(self, place: dict[str, Any], names: Sequence[str], most: int) -> list[dict[str, Any]]:
        """Identical objects, one of which sounds."""
        found: list[dict[str, Any]] = []
        for name in names:
            if len(found) == most:
                break
            first = found[-1]["index"] + 1 if found else 1
            fitting = (
                entry
                for count in COPIES
                for index in range(first, first + TRIES)
                if not self.fault(
                    entry := {"part": "part_2", **place, "index": index, "category": name, "instances": count}
                )
            )
            found += [candidate for candidate in [next(fitting, None)] if candidate is not None]
        return found

    def _siblings(self, entries: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """Three scenes with the same pictures: the one twin sounds, the other one, neither."""
        for entry in entries:
            if entry["part"] != "part_2":
                continue
            name = entry["category"]
            first = {
                "part": "part_3", "scan": entry["scan"], "room": entry["room"], "index": 1,
                "instances": {name: 2}, "sources": [{"category": name, "instance": 1}],
            }  # fmt: skip
            if not self.fault(first):
                like = f"part_3/{entry['scan']}/{entry['room']}/1"
                second = {"like": like, "index": 2, "sources": [{"category": name, "instance": 2}]}
                return [first, second, {"like": like, "index": 3, "sources": []}]
        return []
