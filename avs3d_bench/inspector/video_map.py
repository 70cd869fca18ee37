"""The map in a corner of a film: the floor plan, the way so far, the heading and the source, from above."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from avs3d_bench.dataset import Observation
from avs3d_bench.inspector.facts import Facts
from avs3d_bench.inspector.floorplan import EYES, Bounds, map_bounds, rasterise
from avs3d_bench.inspector.sound_scenes import ShownSource
from avs3d_bench.inspector.video_drawing import GROUND, TRUTH
from avs3d_bench.inspector.video_text import U8, Colour, at_pixel, halved, text_width, write_text

#: Longer side of the map, in widths of the picture.
SIDE = 0.3
_AGENT: Colour = (0, 114, 178)
_WAY, _SILENT = (150, 156, 164), (110, 116, 124)
#: Length of the drawn field of view, metres.
_REACH = 0.75


@dataclass(frozen=True, eq=False)
class MapInset:
    """The map in the corner: everything that does not move is drawn once.

    Attributes:
        facts: of the observation.
        bounds: of the shown area, metres.
        scale: pixels of the double-sized picture a metre.
        ground: (2h, 2w, 3) the floor plan and the placed objects.
    """

    facts: Facts
    bounds: Bounds
    scale: float
    ground: U8

    @classmethod
    def of(cls, observation: Observation, facts: Facts, width: int) -> MapInset | None:
        """Draw everything that does not move, for a film of this width in pixels; None if no frame has a pose.

        Raises:
            Avs3dError: if the sparse model is missing or damaged.
        """
        bounds = map_bounds(facts)
        if bounds is None:
            return None
        side = width * SIDE
        scale = 2 * side / max(bounds.width, bounds.height)
        size = (max(2, round(bounds.width * scale)) & ~1, max(2, round(bounds.height * scale)) & ~1)
        ground = np.full((size[1], size[0], 3), 250, dtype=np.uint8)
        floor = min(m.position[1] for m in facts.moments if m.position) - EYES
        points = observation.colmap.points
        dots = rasterise(points.positions, points.colours, bounds, floor)
        how = cv2.INTER_AREA if dots.shape[1] > size[0] else cv2.INTER_LINEAR
        dots = np.asarray(cv2.resize(dots, size, interpolation=how), np.uint8)
        cover = dots[..., 3:].astype(np.float32) / 255 * 0.7
        ground = np.rint(ground * (1 - cover) + dots[..., :3] * cover).astype(np.uint8)
        inset = cls(facts, bounds, scale, ground)
        for instance in facts.instances:
            if instance.sounding and facts.moves:
                continue
            corners = [inset._pixel(corner) for corner in instance.bounds]
            colour = TRUTH if instance.sounding else _SILENT
            if facts.scene is not None and instance.sounding:
                colour = facts.scene.colours[instance.id]
            cv2.rectangle(ground, corners[0], corners[1], colour, max(1, round(scale * 0.03)), cv2.LINE_AA)
        whole = [inset._pixel(m.position) for m in facts.moments if m.position]
        cv2.polylines(ground, [np.array(whole)], False, _WAY, inset._thick(0.03), cv2.LINE_AA)
        return inset

    def draw(self, number: int) -> U8:
        """The map (h, w, 3) while frame ``number`` is shown: the way so far, the heading, the source."""
        big, moments = self.ground.copy(), self.facts.moments
        way = [self._pixel(m.position) for m in moments[: number + 1] if m.position]
        if way:
            cv2.polylines(big, [np.array(way)], False, _AGENT, self._thick(0.05), cv2.LINE_AA)
        if self.facts.moves:
            trail = [self._pixel(m.source) for m in moments[: number + 1] if m.source]
            cv2.polylines(big, [np.array(trail)], False, TRUTH, self._thick(0.03), cv2.LINE_AA)
        now = moments[number]
        if now.position and now.heading:
            self._agent(big, now.position, now.heading)
        if now.source:
            spot = self._pixel(now.source)
            cv2.circle(big, spot, self._thick(0.14), (255, 255, 255), -1, cv2.LINE_AA)
            cv2.circle(big, spot, self._thick(0.11), TRUTH, -1, cv2.LINE_AA)
            cv2.circle(big, spot, self._thick(0.24), TRUTH, self._thick(0.03), cv2.LINE_AA)
        for source in self.facts.scene.sources if self.facts.scene else ():
            self._source(big, source, audible=source.heard[number] is not None)
        cv2.rectangle(big, (0, 0), (big.shape[1] - 1, big.shape[0] - 1), GROUND, 4)
        return halved(big, (big.shape[0] // 2, big.shape[1] // 2, 3))

    def _source(self, big: U8, source: ShownSource, *, audible: bool) -> None:
        """A source of a sound scene: filled while it is audible; at the border, with its name, if it is off the map."""
        height, width = big.shape[:2]
        inset = self._thick(0.3)
        x, y = self._pixel(source.record.position)
        spot = min(max(x, inset), width - inset), min(max(y, inset), height - inset)
        ring, colour = self._thick(0.04), source.colour
        cv2.circle(big, spot, self._thick(0.14), (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(big, spot, self._thick(0.11), colour, -1 if audible else ring, cv2.LINE_AA)
        if audible:
            cv2.circle(big, spot, self._thick(0.24), colour, ring, cv2.LINE_AA)
        if spot != (x, y) or source.off_screen:
            size = 0.032 * max(height, width) * 1.6
            size *= min(1.0, 0.9 * width / text_width(source.name, size))
            half = text_width(source.name, size) / 2
            left = min(max(spot[0] - half, 8.0), width - 2 * half - 8)
            below = spot[1] + inset + size if spot[1] < height / 2 else spot[1] - inset - 0.4 * size
            panel = big[round(below - size) : round(below + 0.3 * size), round(left - 6) : round(left + 2 * half + 6)]
            panel[:] = np.rint(panel * 0.3 + 250 * 0.7).astype(np.uint8)
            write_text(big, source.name, (left, below), size, GROUND)

    def _agent(self, big: U8, position: tuple[float, float, float], heading: tuple[float, float]) -> None:
        """A dot with the camera's view of 90° before it."""
        x, z = position[0], position[2]
        ahead, right = np.array(heading), np.array([-heading[1], heading[0]])
        angles = np.linspace(-math.pi / 4, math.pi / 4, 15)[:, None]
        view = np.array([x, z]) + _REACH * (ahead * np.cos(angles) + right * np.sin(angles))
        fan = np.array([self._pixel((px, 0.0, pz)) for px, pz in [(x, z), *view.tolist()]])
        lit = cv2.fillPoly(big.copy(), [fan], _AGENT, cv2.LINE_AA)
        cv2.addWeighted(lit, 0.4, big, 0.6, 0, dst=big)
        cv2.circle(big, self._pixel(position), self._thick(0.12), (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(big, self._pixel(position), self._thick(0.09), _AGENT, -1, cv2.LINE_AA)

    def _pixel(self, point: tuple[float, float, float]) -> tuple[int, int]:
        return at_pixel((point[0] - self.bounds.left) * self.scale, (point[2] - self.bounds.top) * self.scale)

    def _thick(self, metres: float) -> int:
        """In pixels; maps of large flats keep readable lines."""
        metre = max(self.scale, 0.12 * max(self.ground.shape[:2]))
        return max(2, int(metres * metre + 0.5))
