"""Places for the labels of a map, so that no two overlap and each is inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

#: Cost of covering any of a label, and in addition a whole label or a whole mark, in label heights of distance.
_TOUCHES_LABEL, _COVERS_LABEL, _COVERS_MARK = 1000.0, 1000.0, 6.0
#: What two labels share by rounding (pixels²).
_ROUNDING = 1e-9
#: Distances from the mark that are tried (label heights).
_STEPS = 13


@dataclass(frozen=True)
class LabelBox:
    """A rectangle in pixels; y grows downwards."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def area(self) -> float:
        """In pixels²."""
        return max(0.0, self.right - self.left) * max(0.0, self.bottom - self.top)

    def nearest(self, other: LabelBox) -> tuple[float, float]:
        """The point of this rectangle that is nearest to the middle of another."""
        x, y = (other.left + other.right) / 2, (other.top + other.bottom) / 2
        return min(max(x, self.left), self.right), min(max(y, self.top), self.bottom)

    def shared(self, other: LabelBox) -> float:
        """Area that both cover, pixels²."""
        width = min(self.right, other.right) - max(self.left, other.left)
        return max(0.0, width) * max(0.0, min(self.bottom, other.bottom) - max(self.top, other.top))


def place_labels(
    marks: Sequence[LabelBox], sizes: Sequence[tuple[float, float]], area: LabelBox, taken: Sequence[LabelBox] = ()
) -> list[LabelBox]:
    """A place for the label of each mark: below, above or beside it, as near as it is free.

    Args:
        marks: what is labelled; labels rather do not cover them.
        sizes: (width, height) of the labels, pixels.
        area: what labels stay within.
        taken: where no label may be.
    """
    placed: list[LabelBox] = []
    for mark, (width, height) in zip(marks, sizes, strict=True):

        def cost(place: tuple[float, LabelBox], height: float = height) -> float:
            away, box = place
            shared = [box.shared(other) for other in (*placed, *taken)]
            covered = sum(shared) * _COVERS_LABEL + sum(box.shared(other) for other in marks) * _COVERS_MARK
            touched = _TOUCHES_LABEL if max(shared, default=0.0) > _ROUNDING else 0.0
            return away / height + touched + covered / max(1e-9, box.area)

        placed.append(min(_places(mark, width, height, area), key=cost)[1])
    return placed


def _places(mark: LabelBox, width: float, height: float, area: LabelBox) -> list[tuple[float, LabelBox]]:
    """Possible places of a label and their distances from its mark, pixels."""
    x, y = (mark.left + mark.right) / 2, (mark.top + mark.bottom) / 2
    found = []
    for step in range(_STEPS):
        out = (0.2 + 0.5 * step) * height
        beside, over = (mark.right - mark.left + width) / 2 + out, (mark.bottom - mark.top + height) / 2 + out
        for across, down in ((0, over), (0, -over), (beside, 0), (-beside, 0),
                             (beside, over), (-beside, over), (beside, -over), (-beside, -over)):  # fmt: skip
            left = max(area.left, min(area.right - width, x + across - width / 2))
            top = max(area.top, min(area.bottom - height, y + down - height / 2))
            box = LabelBox(left, top, left + width, top + height)
            # Below is preferred to above, and both to the sides.
            taste = 0.0 if down > 0 and not across else 0.15 if not across else 0.4
            moved = abs(left + width / 2 - x - across) + abs(top + height / 2 - y - down)
            found.append((out + taste * height + moved, box))
    return found
