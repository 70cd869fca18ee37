"""The map in a corner of a film: the floor plan, the way so far, the heading and the source, from above."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from avs3d_bench.dataset import Observation
from avs3d_bench.inspector.facts import PageFacts
from avs3d_bench.inspector.floorplan import Bounds, map_bounds, paint_plan, read_plan
from avs3d_bench.inspector.labels import LabelBox, place_labels
from avs3d_bench.inspector.sources import ShownSource
from avs3d_bench.inspector.video_drawing import GROUND, TRUTH
from avs3d_bench.inspector.video_text import U8, Colour, at_pixel, halved, text_width, write_text

#: Longer side of the map, in widths of the picture.
SIDE = 0.3
_AGENT: Colour = (0, 114, 178)
_WAY, _SILENT = (150, 156, 164), (110, 116, 124)
#: Outside of all floors.
_OUTSIDE: Colour = (236, 233, 226)
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

    facts: PageFacts
    bounds: Bounds
    scale: float
    ground: U8

    @classmethod
    def of(cls, observation: Observation, facts: PageFacts, width: int) -> MapInset | None:
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
        ground = np.full((size[1], size[0], 3), _OUTSIDE, dtype=np.uint8)
        plan = paint_plan(read_plan(observation, bounds), bounds, size)
        cover = plan[..., 3:].astype(np.float32) / 255
        ground = np.rint(ground * (1 - cover) + plan[..., :3] * cover).astype(np.uint8)
        inset = cls(facts, bounds, scale, ground)
        for instance in facts.instances:
            if instance.sounding and facts.moves:
                continue
            corners = [inset._pixel(corner) for corner in instance.bounds]
            colour = TRUTH if instance.sounding else _SILENT
            if facts.lanes is not None and instance.sounding:
                colour = facts.lanes.colours[instance.id]
            cv2.rectangle(ground, corners[0], corners[1], colour, max(1, round(scale * 0.03)), cv2.LINE_AA)
        whole = [inset._pixel(m.position) for m in facts.moments if m.position]
        cv2.polylines(ground, [np.array(whole)], False, _WAY, inset._thick(0.03), cv2.LINE_AA)
        inset._scale_bar()
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
        sources = self.facts.lanes.sources if self.facts.lanes else ()
        spots = [self._source(big, source, audible=source.heard[number] is not None) for source in sources]
        self._names(big, sources, spots)
        cv2.rectangle(big, (0, 0), (big.shape[1] - 1, big.shape[0] - 1), GROUND, 4)
        return halved(big, (big.shape[0] // 2, big.shape[1] // 2, 3))

    def _source(self, big: U8, source: ShownSource, *, audible: bool) -> tuple[int, int]:
        """A source of part_3: filled while it is audible; at the border if it is off the map. Returns where."""
        height, width = big.shape[:2]
        inset = self._thick(0.3)
        x, y = self._pixel(source.record.position)
        spot = min(max(x, inset), width - inset), min(max(y, inset), height - inset)
        ring, colour = self._thick(0.04), source.colour
        cv2.circle(big, spot, self._thick(0.14), (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(big, spot, self._thick(0.11), colour, -1 if audible else ring, cv2.LINE_AA)
        if audible:
            cv2.circle(big, spot, self._thick(0.24), colour, ring, cv2.LINE_AA)
        return spot

    def _names(self, big: U8, sources: Sequence[ShownSource], spots: Sequence[tuple[int, int]]) -> None:
        """Names of the sources that are off the map or in another room; the others have their colour in the legend."""
        height, width = big.shape[:2]
        reach = self._thick(0.24)
        marks = [LabelBox(x - reach, y - reach, x + reach, y + reach) for x, y in spots]
        chosen = [
            (source, mark)
            for source, spot, mark in zip(sources, spots, marks, strict=True)
            if source.off_screen or spot != self._pixel(source.record.position)
        ]
        size = 0.032 * max(height, width) * 1.6
        sizes = [min(size, size * 0.9 * width / text_width(source.name, size)) for source, _ in chosen]
        boxes = place_labels(
            [mark for _, mark in chosen],
            [(text_width(s.name, z) + 12, 1.3 * z) for (s, _), z in zip(chosen, sizes, strict=True)],
            LabelBox(4, 4, width - 4, height - 4),
            taken=[self._bar],
        )
        for (source, _), letters, box in zip(chosen, sizes, boxes, strict=True):
            panel = big[round(box.top) : round(box.bottom), round(box.left) : round(box.right)]
            panel[:] = np.rint(panel * 0.2 + 250 * 0.8).astype(np.uint8)
            write_text(big, source.name, (box.left + 6, box.top + letters), letters, GROUND)

    @property
    def _bar(self) -> LabelBox:
        """Where the scale is."""
        edge, letters = 0.04 * self.ground.shape[1], 0.045 * max(self.ground.shape[:2])
        bottom = self.ground.shape[0] - edge
        return LabelBox(edge, bottom - 1.6 * letters, edge + max(self.scale, text_width("1 m", letters)), bottom)

    def _scale_bar(self) -> None:
        """A metre, with ticks at its ends."""
        bar, letters, thick = self._bar, 0.045 * max(self.ground.shape[:2]), max(2, round(0.004 * self.ground.shape[1]))
        tick, right = 0.3 * letters, bar.left + self.scale
        lines = [(bar.left, bar.bottom - tick), (bar.left, bar.bottom), (right, bar.bottom), (right, bar.bottom - tick)]
        cv2.polylines(self.ground, [np.array([at_pixel(*at) for at in lines])], False, GROUND, thick, cv2.LINE_AA)
        middle = (bar.left + right - text_width("1 m", letters)) / 2
        write_text(self.ground, "1 m", (max(bar.left, middle), bar.bottom - 0.4 * letters), letters, GROUND)

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
