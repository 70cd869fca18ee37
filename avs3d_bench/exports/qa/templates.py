"""The wordings, options, bins and margins of questions.yaml."""

from __future__ import annotations

from bisect import bisect_right
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import Field

from avs3d_bench.contract.questions import QuestionKind
from avs3d_bench.contract.schema.base import NonNegative, Record, Text
from avs3d_bench.formats.files import read_bytes

#: The option of every kind that is right where nothing sounds, but of `count` and `anything`.
NOTHING = "nothing"


class Margins(Record):
    """What keeps out questions whose answer is nearly another one; questions.yaml says what each is."""

    level_db: float
    snr_db: float
    side_deg: NonNegative
    apart_deg: NonNegative
    moved_deg: NonNegative
    bin_deg: NonNegative
    bin_m: NonNegative
    visible: NonNegative


class KindTemplate(Record):
    """The texts of one kind: wordings, meaning of an option → its text, and edges of bins."""

    wordings: Annotated[tuple[Text, ...], Field(min_length=1)]
    options: dict[str, Text]
    bins: tuple[float, ...] | None = None

    def bin(self, value: float, margin: float) -> str | None:
        """The meaning of the bin that holds a value; None outside of all, and nearer than ``margin`` to an edge."""
        edges = self.bins or ()
        place = bisect_right(edges, value) - 1
        if not 0 <= place < len(edges) - 1 or min(abs(value - edge) for edge in edges[1:-1]) < margin:
            return None
        return tuple(self.options)[place]


class Templates(Record):
    """questions.yaml."""

    version: Literal[1]
    margins: Margins
    kinds: dict[QuestionKind, KindTemplate]

    def meaning(self, kind: QuestionKind, text: str) -> str:
        """The meaning of an option's text; of a letter, the letter."""
        return next((name for name, option in self.kinds[kind].options.items() if option == text), text)


@lru_cache(maxsize=1)
def templates() -> Templates:
    """The texts of this version."""
    return Templates.model_validate(yaml.safe_load(read_bytes(Path(__file__).parent / "questions.yaml")))
