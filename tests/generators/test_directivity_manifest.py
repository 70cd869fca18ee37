"""`directivity` in manifests: what may be said, what it changes, which way a source faces, what is recorded."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import yaml

from avs3d_bench.contract.schema import DirectivityRecord, LicenceRecord, SoundRecord
from avs3d_bench.errors import Avs3dError, UsageError
from avs3d_bench.geometry import Pose
from avs3d_bench.validation.acoustics import GAIN_RANGE_DB, SOURCE_LUFS, check_gain
from generators.acoustics.radiators import modelled
from generators.core.boxes import yaw_matrix
from generators.manifest.schema import ObservationSpec
from generators.observation.hearing import AcousticJob
from generators.observation.record import describe_directivity
from generators.observation.sources import choose_directivity, choose_sources
from generators.options import GenerateOptions
from generators.plan import ObservationPlan, make_plans, read_manifest

SCENE = {"part": "part_3", "scan": "flat", "room": "kitchen", "index": 1, "instances": {"microwave": 2, "clock": 1}}
ANALYTIC = GenerateOptions(audio="analytic")


def plan_of(folder: Path, sources: Any = (), options: GenerateOptions = ANALYTIC, **fields: Any) -> ObservationPlan:
    """The plan of a part_3 observation with these sources, or without any of one of part_1."""
    entry = SCENE | {"sources": list(sources)}
    if not sources:
        entry = {"part": "part_1", "scan": "flat", "room": "kitchen", "index": 1, "category": "microwave"}
    document = {
        "name": "tiny",
        "seed": 1,
        "camera": {"size": 64, "frames": 2},
        "scans": {"flat": {"source": "apartment", "seed": 3}},
        "observations": [entry],
    } | fields
    path = folder / "m.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    (plan,) = make_plans(read_manifest(path), options)
    return plan


def name_of(plan: ObservationPlan, number: int = 0) -> str | None:
    found = choose_directivity(plan, plan.spec.sounding[number])
    return found and found.name


def test_without_the_word_the_document_of_the_digest_is_that_of_earlier_versions():
    spec = ObservationSpec.model_validate(SCENE | {"sources": [{"category": "clock"}]})
    assert "directivity" not in spec.identity()
    assert set(spec.identity()["sources"][0]) == {"category", "instance", "room", "programme", "gain_db"}
    said = ObservationSpec.model_validate(SCENE | {"sources": [{"category": "clock"}], "directivity": "omni"})
    assert said.identity() == spec.identity()


def test_a_source_overrides_its_observation_and_that_the_manifest(tmp_path: Path):
    sources = [
        {"category": "microwave", "directivity": {"cardioid": 2, "axis": [0, 1, 0], "omni_share": 0.25}},
        {"category": "microwave", "directivity": "omni"},
        {"category": "clock"},
        {"category": "clock", "room": "living_room"},
    ]
    plan = plan_of(tmp_path, sources, directivity="auto")
    assert [name_of(plan, number) for number in range(4)] == [
        "cardioid of order 2, omni share 0.25, axis (0, 1, 0)",
        None,
        "model of clock: the dial",
        None,  # no object, and so no front
    ]
    assert name_of(plan_of(tmp_path)) is None
    assert name_of(plan_of(tmp_path, directivity="auto")) == "model of microwave: the front with its door"


def test_a_directivity_changes_the_digest_of_the_sound_and_not_that_of_the_pictures(tmp_path: Path):
    plain, auto = plan_of(tmp_path), plan_of(tmp_path, directivity="auto")
    assert plain.digest != auto.digest
    assert plain.pictures_digest == auto.pictures_digest
    licence = {"name": "CC0-1.0", "author": "someone"}
    (tmp_path / "a.sofa").write_bytes(b"one")
    digests = set()
    for content in (b"one", b"two"):
        (tmp_path / "a.sofa").write_bytes(content)
        digests.add(plan_of(tmp_path, directivity={"file": "a.sofa", "licence": licence}).digest)
    assert len(digests) == 2
    with pytest.raises(Avs3dError, match=r"b\.sofa: directivity not found"):
        plan_of(tmp_path, directivity={"file": "b.sofa", "licence": licence}).check_files()


def test_a_table_beside_the_manifest_is_the_sources_directivity(tmp_path: Path):
    rows = [f"{a},0,{','.join([str(1 if a == 0 else 0.25)] * 6)}" for a in (-90, 0, 90, 180)]
    (tmp_path / "horn.csv").write_text("azimuth,elevation,125,250,500,1000,2000,4000\n" + "\n".join(rows) + "\n")
    licence = {"name": "CC0-1.0", "author": "someone"}
    plan = plan_of(tmp_path, directivity={"file": "horn.csv", "licence": licence})
    found = choose_directivity(plan, plan.spec.sounding[0])
    assert found is not None
    assert found.amplitudes([[0, 0, 1], [1, 0, 0], [0, 0, -1]])[:, 3] == pytest.approx([1.0, 0.25, 0.25])
    assert found.name.startswith("table horn.csv, sha256 ")


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("auot", "directivity: found 'auot'; expected omni, auto, {cardioid: ORDER} or"),
        ({}, "directivity: found nothing; expected exactly one of omni, auto, {cardioid: ORDER}"),
        ({"word": "auto"}, "directivity: found"),
        ({"cardioid": 99}, "directivity.cardioid: .*16.*99"),
        ({"cardioid": True}, "directivity.cardioid: "),
        ({"cardioid": 1, "axis": [0, 0, 0]}, r"directivity.axis: \[0, 0, 0\] is no direction"),
        ({"cardioid": 1, "axis": [0, float("nan"), 0]}, "directivity.axis.1: .*finite"),
        ({"cardioid": 1, "omni_share": 2}, "directivity.omni_share: "),
        ({"cardioid": 1, "file": "a.sofa"}, "found cardioid and file; expected exactly one"),
        ({"file": "a.sofa"}, "file and licence belong together"),
        ({"file": "a.sofa", "axis": [0, 1, 0]}, "axis and omni_share belong to cardioid"),
    ],
)
def test_what_makes_no_sense_is_one_line(tmp_path: Path, value: Any, message: str):
    with pytest.raises(UsageError, match=message) as caught:
        plan_of(tmp_path, [{"category": "clock", "directivity": value}])
    assert str(caught.value).count("\n") == 0
    assert "m.yaml" in str(caught.value)


def test_a_source_without_an_object_faces_nowhere(tmp_path: Path):
    source = {"category": "clock", "room": "living_room", "directivity": "auto"}
    with pytest.raises(UsageError, match=r"sources\.0: .*has no object, and faces nowhere"):
        plan_of(tmp_path, [source])


def test_an_engine_without_directivities_is_refused_before_anything_is_made(tmp_path: Path):
    with pytest.raises(
        UsageError, match="tiny: part_1/flat/kitchen/1: directivity needs the engine tracer or analytic"
    ):
        plan_of(tmp_path, options=GenerateOptions(audio="soundspaces"), directivity="auto")


def test_a_source_faces_where_its_object_does(tmp_path: Path):
    def placed(category: str, yaw: float, x: float = 1.0) -> Any:
        return SimpleNamespace(model=SimpleNamespace(category=category), yaw=yaw, source_position=(x, 1.0, 2.0))

    plan = plan_of(tmp_path, [{"category": "clock"}], directivity="auto")
    arrangement: Any = SimpleNamespace(
        placements=[placed("microwave", 0.3), placed("microwave", 0.4), placed("clock", 2.0)], motions=()
    )
    (source,) = choose_sources(plan, cast(Any, None), arrangement)
    (pose,) = source.poses
    assert pose.position == (1.0, 1.0, 2.0)
    assert pose.rotation_matrix @ [0, 0, 1] == pytest.approx(yaw_matrix(2.0) @ [0, 0, 1])
    moving = plan_of(tmp_path, directivity="auto")
    seconds = [placed("microwave", yaw, x) for yaw, x in ((0.0, 1.0), (0.5, 1.2), (1.0, 1.4))]
    arrangement = SimpleNamespace(placements=seconds[:1], motions=[SimpleNamespace(index=0, seconds=seconds)])
    (source,) = choose_sources(moving, cast(Any, None), arrangement)
    assert source.poses == tuple(Pose.from_yaw(one.source_position, one.yaw) for one in seconds)
    job = AcousticJob(
        options=moving.options, absorption_scale=1.0, seed=None, scene=cast(Any, None), room="kitchen",
        samples=np.zeros(1, np.float32), poses=(), path=source.poses, directivity=source.directivity,
    )  # fmt: skip
    assert [job.place(second) for second in range(3)] == list(source.poses)
    plain = AcousticJob(**(vars(job) | {"directivity": None}))
    assert plain.place(1) == (1.2, 1.0, 2.0), "engines that know of no directivity get points"


def test_the_record_says_what_it_is_and_files_without_one_keep_their_bytes():
    source: Any = SimpleNamespace(directivity=modelled("clock"), directivity_licence=None)
    found = describe_directivity(source)
    assert found is not None
    assert found.name == "model of clock: the dial"
    assert found.index_db[1000] == pytest.approx(modelled("clock").index()[1000], abs=0.01)  # type: ignore[union-attr]
    assert describe_directivity(cast(Any, SimpleNamespace(directivity=None))) is None
    licence = LicenceRecord(name="CC0-1.0", author="a", source="b")
    assert "directivity" in SoundRecord.left_out
    again = SoundRecord.model_validate_json(
        SoundRecord(asset="x", licence=licence, directivity=found).model_dump_json()
    )
    assert again.directivity == found


def test_validation_allows_a_source_the_level_that_its_directivity_takes():
    """A source 4 dB below the least level is an error, unless its directivity index is 6 dB."""

    def record_with(directivity: DirectivityRecord | None) -> Any:
        return SimpleNamespace(
            acoustics=SimpleNamespace(gain=0.1), sound_sources=(SimpleNamespace(directivity=directivity),)
        )

    level = 10 ** ((SOURCE_LUFS + GAIN_RANGE_DB[0] - 4.0) / 20) * 0.1
    sound = SimpleNamespace(rms=(level, level), samples=np.array([level]))
    heard: Any = [SimpleNamespace(sound=sound, distance=1.0, gain_db=0.0)] * 8
    said: list[str] = []
    findings: Any = SimpleNamespace(add=lambda file, text: said.append(text))
    check_gain(record_with(DirectivityRecord(name="a beam", index_db={1000: 6.0})), heard, findings)
    assert not said
    check_gain(record_with(None), heard, findings)
    assert len(said) == 1
