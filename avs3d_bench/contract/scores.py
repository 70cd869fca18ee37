"""The record behind the file of scores that `avs3d-eval --json` writes, and the names of its metrics.

Values without a unit lie in [0, 1]. A value that the data cannot give is null, with the reason in `unavailable`; no
value is guessed. docs/metrics.md has the formulas.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field

from avs3d_bench.contract.schema import (
    NonNegative,
    ProvenanceRecord,
    Record,
    RelativePath,
    Room,
    Scan,
    Sha256,
    SubmissionRecord,
    Text,
)
from avs3d_bench.errors import UsageError, did_you_mean, excerpt
from avs3d_bench.text.printable import printable

if TYPE_CHECKING:
    from avs3d_bench.contract.score_frames import DataFrame

Protocol = Literal["official", "strict", "listen"]
#: Protocol → version. It changes when a figure changes for the same masks, and when one is added: 1.1 of ``listen`` has
#: the pair accuracy by kind of pair; its other figures are those of 1.0.
PROTOCOLS: dict[Protocol, str] = {"official": "1.0", "strict": "1.0", "listen": "1.1"}
#: Protocol → parts whose observations it scores.
PROTOCOL_PARTS: dict[Protocol, tuple[str, ...]] = {
    "official": ("part_1", "part_2"),
    "strict": ("part_1", "part_2"),
    "listen": ("part_3",),
}
#: Reference rows printed with every score: submissions that use neither pictures nor sound …
BLIND_REFERENCES = ("all_black", "all_white", "centre_box")
#: … and submissions with true masks that do not use the sound: under ``strict``, if the instances are known.
DEAF_REFERENCES = ("deaf_category", "deaf_most_seen")
REFERENCES = (*BLIND_REFERENCES, *DEAF_REFERENCES)
#: Under ``listen``: true masks of instances, the same for all siblings of a group; see
#: `avs3d_bench.measures.deaf_oracles`.
DEAF_ORACLES = ("deaf_all", "deaf_single")
LISTEN_REFERENCES = (*BLIND_REFERENCES, *DEAF_ORACLES)
#: Every reference row, in the order of tables.
ALL_REFERENCES = (*REFERENCES, *DEAF_ORACLES)

#: Kind of a pair of siblings, named after what tells the two apart; see `avs3d_bench.measures.pair_kinds`.
PairKind = Literal["twins", "category", "off_screen", "silence", "several"]
#: Every kind, the one that needs the most of the ears first: the figures of ``listen`` with these names are the pair
#: accuracy over pairs of one kind.
PAIR_KINDS: tuple[PairKind, ...] = get_args(PairKind)
#: The figures of ``listen`` that are means over groups of siblings and not over observations.
PAIR_FIGURES: tuple[str, ...] = ("pair_accuracy", *PAIR_KINDS)

#: E.g. ``1.0``.
ProtocolVersion = Annotated[str, Field(pattern=r"^[0-9]{1,4}(\.[0-9]{1,4}){0,3}$")]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
PartName = Literal["part_1", "part_2", "part_3"]


@dataclass(frozen=True)
class Metric:
    """Name, unit and direction of a figure, for tables and pages.

    Attributes:
        protocol: its protocol.
        name: its key in the file of scores.
        title: its name in tables and pages.
        higher_is_better: whether larger values are better.
        unit: ``""`` for shares, ``"m"`` for metres.
        meaning: its definition in one line.
    """

    protocol: Protocol
    name: str
    title: str
    higher_is_better: bool
    unit: str
    meaning: str


#: Every figure, in the order in which tables show it.
METRICS: tuple[Metric, ...] = (
    Metric("official", "mIoU", "mIoU", True, "", "IoU as released; without an object, the share of unmarked pixels"),
    Metric("official", "F", "F", True, "", "F (β² = 0.3) as released; never below that of an all-white mask"),
    Metric("strict", "IoU", "IoU", True, "", "IoU of the mask over frames in which the object is visible"),
    Metric("strict", "F", "F", True, "", "F (β² = 0.3) of the mask over frames in which the object is visible"),
    Metric("strict", "boundary_F", "boundary F", True, "", "F of the outlines within 0.8 % of the image diagonal"),
    Metric("strict", "FP_rate", "FP rate", False, "", "share of frames without the object that have a marked pixel"),
    Metric("strict", "FP_area", "FP area", False, "", "share of marked pixels in frames without the object"),
    Metric("strict", "wrong_instance_rate", "wrong instance", False, "",
           "share of the frames with a silent twin in which a twin is marked"),
    Metric("strict", "IoU_3D", "3D IoU", True, "", "IoU of 5 cm voxels with those of the object's mesh"),
    Metric("strict", "centroid_error", "centroid error", False, "m",
           "distance between the centroids of the predicted and the true voxels"),
    Metric("listen", "twins", "twins", True, "",
           "pair accuracy over pairs of which two instances of one category sound, one in each"),
    Metric("listen", "pair_accuracy", "pair accuracy", True, "",
           "share of the frames of pairs of siblings in which both predictions are right, each for its own sound"),
    Metric("listen", "category", "category", True, "",
           "pair accuracy over pairs of which instances of two categories sound, one in each"),
    Metric("listen", "off_screen", "off-screen", True, "",
           "pair accuracy over pairs in one of which a source in another room sounds alone"),
    Metric("listen", "silence", "silence", True, "",
           "pair accuracy over pairs in one of which nothing sounds, or in both the same at other times"),
    Metric("listen", "several", "several", True, "",
           "pair accuracy over pairs in one of which more than one source sounds"),
    Metric("listen", "IoU", "IoU", True, "", "IoU of the mask over frames in which something audible is visible"),
    Metric("listen", "FP_rate", "FP rate", False, "", "share of frames with nothing to mark that have a marked pixel"),
    Metric("listen", "FP_area", "FP area", False, "", "share of marked pixels in frames with nothing to mark"),
    Metric("listen", "class_mIoU", "class mIoU", True, "", "IoU of the categories, mean over those that occur"),
)  # fmt: skip


def metrics_of(protocol: str) -> tuple[Metric, ...]:
    """The figures of one protocol, in order."""
    return tuple(metric for metric in METRICS if metric.protocol == protocol)


class OfficialScore(Record):
    """Figures of the released scoring (protocol ``official``)."""

    mIoU: Share  # noqa: N815 - the key is pinned
    F: Share


class StrictScore(Record):
    """Figures without the quirks of the released scoring (protocol ``strict``)."""

    IoU: Share | None
    F: Share | None
    boundary_F: Share | None  # noqa: N815
    FP_rate: Share | None
    FP_area: Share | None
    wrong_instance_rate: Share | None
    IoU_3D: Share | None
    centroid_error: NonNegative | None = Field(description="distance of the centroids, metres")


class OfficialObservation(OfficialScore):
    """One observation under ``official``."""


class StrictObservation(StrictScore):
    """One observation under ``strict``."""

    visible_frames: Count = Field(description="test frames in which the sounding object is visible")
    absent_frames: Count = Field(description="test frames in which it is not visible")
    twin_frames: Count | None = Field(description="test frames with a silent twin; null if unknown")
    unavailable: dict[str, str] = Field(default_factory=dict, description="figure that is null → reason")


class ListenScore(Record):
    """Whether a method listens: figures of the part_3 observations (protocol ``listen``).

    ``twins`` to ``several`` are the pair accuracy over the pairs of one kind; files of ``listen`` 1.0 lack them.
    """

    left_out: ClassVar[frozenset[str]] = frozenset(PAIR_KINDS)

    pair_accuracy: Share | None
    twins: Share | None = Field(default=None, description="null in files of listen 1.0, as the four below")
    category: Share | None = None
    off_screen: Share | None = None
    silence: Share | None = None
    several: Share | None = None
    IoU: Share | None
    FP_rate: Share | None
    FP_area: Share | None
    class_mIoU: Share | None  # noqa: N815
    unavailable: dict[str, str] = Field(default_factory=dict, description="figure that is null → reason")

    def omitted(self) -> frozenset[str]:
        """The kinds of which the file says nothing, not even why: those of a file of ``listen`` 1.0."""
        return self.left_out - self.unavailable.keys()


class ListenObservation(ListenScore):
    """One observation under ``listen``; the pair accuracies are over the pairs that it takes part in."""

    visible_frames: Count = Field(description="test frames in which something audible is visible")
    absent_frames: Count = Field(description="test frames in which nothing audible is visible")
    pair_frames: Count = Field(description="frames of pairs with a sibling in which the truths differ")
    class_IoU: dict[str, Share] = Field(  # noqa: N815
        description="category that occurs in truth or prediction → its IoU; empty without categories/"
    )


class ObservationDigests(Record):
    """The files of one observation that were scored, and those that they were compared with.

    Each digest is the sha256 of a list with one line per file: the file's sha256, two spaces, the file's path relative
    to the root of the submission or dataset, a line break. The lines are sorted by path.
    """

    predictions: Sha256 = Field(description="digest of the list of files of the submission that were read")
    truth: Sha256 = Field(
        description="digest of the list of files with the truth: observation.json, the mesh in gt_3d/, and the "
        "semantic, instance and category mask of each test frame, as far as they exist"
    )


#: Field of a manifest that variants may differ in.
ConditionField = Literal["acoustics.absorption_scale", "background.snr_db", "background.kind"]


class ConditionRecord(Record):
    """Acoustics and background of an observation that is one of several variants, which share all else."""

    variant_of: Text = Field(description="key of the original; the observation's own if it is the original")
    values: dict[ConditionField, float | Literal["room_tone", "noise"] | None] = Field(
        description="field of the manifest → its value, e.g. background.snr_db → 10; null: no background"
    )
    t30: NonNegative | None = Field(default=None, description="reverberation time in observation.json, seconds")


class ObservationScores(Record):
    """One observation."""

    left_out: ClassVar[frozenset[str]] = frozenset({"group", "listen", "digests", "condition"})

    key: Text
    part: PartName
    scan: Scan
    room: Room
    category: str | None = Field(
        description="null in the official release, which does not contain it, and in part_3 where nothing sounds"
    )
    group: Text | None = Field(
        default=None, description="only in part_3: key of the observation whose pictures this one has"
    )
    condition: ConditionRecord | None = Field(
        default=None, description="only where variants of the same observation were scored"
    )
    frames: Count = Field(description="test frames scored")
    official: OfficialObservation | None = None
    strict: StrictObservation | None = None
    listen: ListenObservation | None = Field(default=None, description="only in part_3")
    digests: ObservationDigests | None = Field(default=None, description="null in files of older versions")


Interval = tuple[float, float]


class OfficialSummary(OfficialScore):
    """Unweighted means over observations."""

    intervals: dict[str, Interval] = Field(
        default_factory=dict,
        description="95 % bootstrap interval over homes, then observations; from six of these on",
    )


class StrictSummary(StrictScore):
    """Unweighted means over the observations for which the figure is not null."""

    intervals: dict[str, Interval] = Field(
        default_factory=dict,
        description="95 % bootstrap interval over homes, then observations; from six of these on",
    )
    counts: dict[str, Count] = Field(description="figure → number of observations in its mean")
    unavailable: dict[str, str] = Field(default_factory=dict, description="figure that is null → reason")


class ListenSummary(ListenScore):
    """Unweighted means over the observations for which the figure is not null; pair accuracies over groups."""

    intervals: dict[str, Interval] = Field(
        default_factory=dict,
        description="95 % bootstrap interval over homes, then groups; from six groups on",
    )
    counts: dict[str, Count] = Field(
        description="figure → number of observations in its mean; of a pair accuracy, number of groups"
    )
    groups: Count = Field(description="number of groups of siblings among the observations")


class GroupScores(Record):
    """Means over a group of observations: a part, a category, a room, all."""

    left_out: ClassVar[frozenset[str]] = frozenset({"listen"})

    observations: Count
    frames: Count
    official: OfficialSummary | None = None
    strict: StrictSummary | None = None
    listen: ListenSummary | None = Field(default=None, description="means over the observations of part_3")


class SoftSummary(Record):
    """Average precision of soft masks over a group of observations."""

    AP: Share | None = Field(description="unweighted mean over observations that show what sounds; null without any")
    interval: Interval | None = Field(description="95 % bootstrap interval, as those of protocol strict")
    count: Count = Field(description="number of observations in the mean")


class SoftScores(Record):
    """Average precision of soft masks, which are no part of the submission."""

    overall: SoftSummary
    parts: dict[PartName, SoftSummary]
    observations: dict[str, Share | None] = Field(
        description="key → mean over the test frames that show what sounds; null without any"
    )


class PairScores(Record):
    """Two siblings: observations with the same pictures and different sound."""

    left_out: ClassVar[frozenset[str]] = frozenset({"kind"})

    first: Text = Field(description="key of one sibling")
    second: Text = Field(description="key of the other")
    kind: PairKind | None = Field(
        default=None, description="what tells the two apart; null in files of listen 1.0, and without observation.json"
    )
    frames: Count = Field(description="test frames in which their truths differ (IoU below 0.5)")
    right: Count = Field(description="frames of these in which both predictions are right, each for its own sound")


class SiblingScores(Record):
    """The scored siblings of one group of part_3, and their pairs."""

    group: Text = Field(description="key of the observation whose pictures all of them have")
    observations: tuple[Text, ...] = Field(description="keys of the siblings that were scored")
    pairs: tuple[PairScores, ...] = Field(description="every two of them")


class Machine(Record):
    """The machine that computed the figures, without a name of host or user."""

    platform: Text = Field(description="operating system and processor architecture, e.g. Linux x86_64")
    python: Text = Field(description="implementation and version, e.g. CPython 3.11.9")
    cores: Annotated[int, Field(ge=1)] = Field(description="processor cores that the process could use")


class Evaluator(Record):
    """The software and settings that computed the figures."""

    left_out: ClassVar[frozenset[str]] = frozenset({"provenance", "machine", "bootstrap_unit"})

    version: Text
    protocols: dict[Protocol, ProtocolVersion] = Field(description="each requested protocol → its version")
    bootstrap_resamples: Count
    bootstrap_seed: Count
    bootstrap_unit: Literal["home"] | None = Field(
        default=None,
        description="what intervals resample first, and then the observations or groups of siblings in it; null in "
        "files of older versions, whose intervals resample these alone",
    )
    voxel_size: NonNegative = Field(description="edge of the voxels of the 3D figures, metres")
    provenance: ProvenanceRecord | None = None
    machine: Machine | None = Field(default=None, description="null in files of older versions")


class ScoredSubmission(SubmissionRecord):
    """The contents of submission.json, and the layout of the submission's folder."""

    left_out: ClassVar[frozenset[str]] = SubmissionRecord.left_out | {"digest"}

    layout: Literal["avs3d", "official"] = Field(description="layout of the folder")
    masks: Text | None = Field(default=None, description="folder of the masks, below the observation's folder")
    points: bool = Field(description="whether it has a 3D prediction")
    digest: Sha256 | None = Field(
        default=None,
        description="of what was scored: sha256 of a list with one line per observation, sorted by key: its "
        "digests.predictions, two spaces, its key, a line break. submission.json is not part of it",
    )


class ScoredDataset(Record):
    """The dataset with which the submission was compared."""

    left_out: ClassVar[frozenset[str]] = frozenset({"provenance", "truth_digest"})

    name: Text
    version: str | None = Field(description="null in the official release")
    sha256: Sha256 | None = Field(description="sha256 of dataset.json; null in the official release")
    observations: Count = Field(description="number of observations in the dataset")
    scored: Count = Field(description="number of observations that were scored; fewer only with --only")
    provenance: ProvenanceRecord | None = Field(default=None, description="that of dataset.json")
    truth_digest: Sha256 | None = Field(
        default=None,
        description="of the truth of the scored observations: as submission.digest, with digests.truth",
    )


def _figure(scores: ObservationScores | GroupScores, metric: Metric) -> float | None:
    """A figure of an observation or a group; None where it is missing."""
    found: float | None = getattr(getattr(scores, metric.protocol), metric.name, None)
    return found


class Scores(Record):
    """The file of scores that `avs3d-eval --json` writes."""

    left_out: ClassVar[frozenset[str]] = frozenset({"siblings", "soft"})

    avs3d_eval: Evaluator
    submission: ScoredSubmission
    dataset: ScoredDataset
    report: RelativePath | None = Field(
        default=None, description="path of the HTML report, if it is in the folder of this file or below"
    )
    observations: tuple[ObservationScores, ...]
    siblings: tuple[SiblingScores, ...] | None = Field(default=None, description="the groups of part_3")
    soft: SoftScores | None = Field(default=None, description="only with --soft-masks")
    overall: GroupScores
    parts: dict[PartName, GroupScores]
    categories: dict[str, GroupScores]
    rooms: dict[str, GroupScores]
    references: dict[str, dict[str, GroupScores]] = Field(
        description="all_black, all_white, centre_box and, if the instances are known, deaf_category and "
        "deaf_most_seen (official and strict), deaf_all and deaf_single (listen) → each part, overall"
    )
    references_unavailable: dict[str, str] = Field(
        default_factory=dict, description="reference of protocol strict or listen that is missing → reason"
    )

    def __repr__(self) -> str:
        return f"Scores({self.headline()})"

    def __str__(self) -> str:
        """The headline, and a table of the parts."""
        rows = self._table()
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ("  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows)
        return "\n".join([self.headline(), *lines])

    def _repr_html_(self) -> str:
        """The same for notebooks."""
        head, *rows = [[escape(cell) for cell in row] for row in self._table()]
        body = "".join(f"<tr><th>{row[0]}</th><td>{'</td><td>'.join(row[1:])}</td></tr>" for row in rows)
        return f"<p>{escape(self.headline())}</p><table><tr><th>{'</th><th>'.join(head)}</th></tr>{body}</table>"

    def _figures(self) -> list[tuple[str, Metric]]:
        """The figures of the computed protocols, with the names of their columns."""
        return [(f"{m.protocol}.{m.name}", m) for m in METRICS if m.protocol in self.avs3d_eval.protocols]

    def _table(self) -> list[list[str]]:
        """Head and rows: a column for each part and overall, a row for each figure that any of them has."""
        groups: list[tuple[str, GroupScores]] = [*self.parts.items(), ("overall", self.overall)]
        rows = [["", *(f"{name} ({group.observations})" for name, group in groups)]]
        for name, metric in self._figures():
            values = [_figure(group, metric) for _, group in groups]
            if any(value is not None for value in values):
                rows.append([name, *("–" if value is None else f"{value:.3f}" for value in values)])
        return rows

    def to_frame(self, rows: Literal["observations", "parts", "categories", "rooms"] = "observations") -> DataFrame:
        """The scores as a table of pandas.

        Args:
            rows: ``observations``: one for each, with its part, scan, room, category and number of test frames. Else
                means over groups: ``parts`` (and overall), ``categories`` or ``rooms``, with the number of
                observations and, where there is an interval, its ends, as ``strict.IoU.low`` and ``strict.IoU.high``.

        Returns:
            A row for each, indexed by key or name; figures have columns ``protocol.name``, as ``strict.IoU``. Missing
            values are NaN.

        Raises:
            UsageError: if ``rows`` is another word.
            Avs3dError: if pandas is not installed.
        """
        from avs3d_bench.contract.score_frames import frame_of

        if rows == "observations":
            index, found = "key", [self._observation_row(one) for one in self.observations]
        elif rows in ("parts", "categories", "rooms"):
            groups: dict[str, GroupScores] = {**getattr(self, rows)}
            groups |= {"overall": self.overall} if rows == "parts" else {}
            index, found = rows, [self._group_row(rows, name, group) for name, group in groups.items()]
        else:
            words = ("observations", "parts", "categories", "rooms")
            raise UsageError(f"rows: {excerpt(rows)}, expected {', '.join(words)}{did_you_mean(rows, words)}")
        return frame_of(found, index, PROTOCOLS)

    def _observation_row(self, one: ObservationScores) -> dict[str, Any]:
        about = {name: getattr(one, name) for name in ("key", "part", "scan", "room", "category", "frames")}
        return about | {name: _figure(one, metric) for name, metric in self._figures()}

    def _group_row(self, kind: str, name: str, group: GroupScores) -> dict[str, Any]:
        row: dict[str, Any] = {kind: name, "observations": group.observations, "frames": group.frames}
        for column, metric in self._figures():
            row[column] = _figure(group, metric)
            scores = getattr(group, metric.protocol)
            interval = scores.intervals.get(metric.name) if scores is not None else None
            if interval is not None:
                row[f"{column}.low"], row[f"{column}.high"] = interval
        return row

    def headline(self) -> str:
        """Method, dataset, number of observations, and the first two figures of each protocol, in one line."""
        data = self.dataset
        scored = f"{data.scored}" if data.scored == data.observations else f"{data.scored} of {data.observations}"
        figures = []
        for protocol in self.avs3d_eval.protocols:
            group = getattr(self.overall, protocol)
            for metric in metrics_of(protocol)[:2] if group is not None else ():
                value = getattr(group, metric.name)
                figures.append(f"{protocol} {metric.title} {'–' if value is None else f'{value:.3f}'}")
        where = f"{data.name} {data.version or '(official release)'}"
        return printable(f"{self.submission.method!r} on {where}, {scored} observations: {', '.join(figures)}")


class UnconfirmedValue(Record):
    """A value of a file of scores that scoring the submission again did not give."""

    where: str = Field(description="e.g. observations[part_1/apartment_1/kitchen/1].strict.IoU")
    recorded: str = Field(description="the value in the file, as text")
    found: str = Field(description="the value of scoring again, as text")


class VerifiedScores(Record):
    """The file of scores that was verified."""

    method: Text
    digest: Sha256 = Field(
        description="sha256 of the file's contents, without `report`: the digest of the entry in a leaderboard"
    )


class VerifiedDataset(Record):
    """The dataset with which the submission was scored again."""

    name: Text
    version: str | None = Field(description="null in the official release")
    sha256: Sha256 | None = Field(description="sha256 of dataset.json; null in the official release")
    truth_digest: Sha256 | None = Field(description="as in a file of scores; null if nothing was scored again")


class VerificationRecord(Record):
    """The file that `avs3d verify --json` writes.

    Nothing in it is secret: whoever has a file of scores can write such a record. It says something only to those who
    know who made it.
    """

    same: bool = Field(description="whether every value that was compared is the same")
    values: Count = Field(description="number of values that were compared")
    differences: tuple[UnconfirmedValue, ...]
    notes: tuple[str, ...]
    scores: VerifiedScores
    dataset: VerifiedDataset
    evaluator: Text = Field(description="version of the toolkit that scored again")

    def __repr__(self) -> str:
        outcome = "same" if self.same else f"{len(self.differences)} differences"
        return f"VerificationRecord({self.scores.method!r}: {outcome}, {self.values} values)"

    __str__ = __repr__
