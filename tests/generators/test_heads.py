"""The family of parametric heads: what is drawn, what it sounds like, and who shares a head."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from avs3d_bench.contract.schema import AcousticsRecord, HeadRecord
from avs3d_bench.errors import Avs3dError, UsageError
from generators.acoustics import receivers as chosen_receivers
from generators.acoustics.geometry import SPEED_OF_SOUND
from generators.acoustics.heads import EAR_AZIMUTH, EAR_ELEVATION, FAMILIES, RADIUS, draw_head, is_of
from generators.acoustics.receivers import OWN_HEAD, choose_receivers, head_identity
from generators.acoustics.tracer.arrivals import Arrivals
from generators.acoustics.tracer.receivers.parametric import ear_axes, parametric_head, pinna
from generators.acoustics.tracer.receivers.sphere import sphere_response
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest

RATE = 44_100
MANIFEST = """
name: heads
seed: 5
{more}
scans: {{apartment_1: {{seed: 1}}}}
observations:
  - {{part: part_1, scan: apartment_1, room: bathroom, index: 1, category: washing_machine}}
  - {{like: part_1/apartment_1/bathroom/1, index: 2, acoustics: {{absorption_scale: 2.0}}}}
  - {{part: part_1, scan: apartment_1, room: kitchen, index: 1, category: microwave}}
  - {{part: part_3, scan: apartment_1, room: bathroom, index: 1, instances: {{washing_machine: 2}},
     sources: [{{category: washing_machine, instance: 1}}]}}
  - {{like: part_3/apartment_1/bathroom/1, index: 2, sources: []}}
"""


def a_head(**changes) -> HeadRecord:
    return draw_head("train", np.random.default_rng(3)).model_copy(update=changes)


def plans(tmp_path: Path, more: str = "", **options):
    path = tmp_path / "manifest.yaml"
    path.write_text(MANIFEST.format(more=more))
    return make_plans(read_manifest(path), GenerateOptions(**options))


def heads(found) -> list[HeadRecord | None]:
    return [plan.options.receivers.drawn for plan in found]


def towards(azimuth: float, elevation: float = 0.0) -> np.ndarray:
    a, e = math.radians(azimuth), math.radians(elevation)
    return np.array([[math.cos(e) * math.sin(a), math.sin(e), -math.cos(e) * math.cos(a)]])


# What is drawn
def test_heads_of_training_and_testing_are_disjoint_and_fill_the_ranges() -> None:
    rng = np.random.default_rng(0)
    drawn = {split: [draw_head(split, rng) for _ in range(400)] for split in ("train", "test")}
    for split, other in (("train", "test"), ("test", "train")):
        radii = np.array([head.radius for head in drawn[split]])
        assert all(is_of(head, split) and not is_of(head, other) for head in drawn[split])
        assert (radii.min(), radii.max()) == pytest.approx(RADIUS, abs=0.003)
        azimuths, elevations = (
            [getattr(head, name) for head in drawn[split]] for name in ("ear_azimuth", "ear_elevation")
        )
        assert EAR_AZIMUTH[0] <= min(azimuths) < max(azimuths) <= EAR_AZIMUTH[1]
        assert EAR_ELEVATION[0] <= min(elevations) < max(elevations) <= EAR_ELEVATION[1]
    nearest = np.abs(np.subtract.outer(*([head.radius for head in each] for each in drawn.values()))).min()
    assert nearest > 1e-4  # 0.1 mm: no head for testing has the radius of one for training


def test_a_head_survives_its_record() -> None:
    head = a_head()
    record = AcousticsRecord(backend="tracer", version="3", sample_rate=RATE, gain=0.1, head=head)
    assert AcousticsRecord.model_validate_json(record.model_dump_json()).head == head


# What it sounds like
def test_the_first_notch_is_where_it_was_drawn_and_rises_with_elevation() -> None:
    head = a_head(peaks=(), notches=a_head().notches[:1])
    frequency = np.arange(3000.0, 1.25 * head.notches[0].frequency, 10.0)
    lowest = []
    for elevation in (-45, 0, 45):
        level = 20 * np.log10(np.abs(pinna(head, towards(0, elevation), frequency)[0]))
        lowest.append(frequency[level.argmin()])
    assert lowest[1] == pytest.approx(head.notches[0].frequency, rel=0.03)
    rise = head.notches[0].rise * math.sin(math.radians(45))
    assert lowest[0] / lowest[1] == pytest.approx(1 - rise, rel=0.03)
    assert lowest[2] / lowest[1] == pytest.approx(1 + rise, rel=0.03)


def test_front_and_back_and_both_sides_of_the_interaural_axis() -> None:
    head, frequency = a_head(), np.geomspace(200, 16_000, 60)
    front, back = (20 * np.log10(np.abs(pinna(head, towards(a), frequency)[0])) for a in (0, 180))
    assert np.abs(front - back)[frequency > 5000].mean() > 3
    assert np.abs(front - back)[frequency < 500].max() < 0.3
    # At the end of the axis the direction about it has no meaning: neighbours agree.
    side = [towards(90), towards(89.9), towards(90, 0.1), towards(90.1)]
    near = [np.abs(pinna(head, each, frequency)[0]) for each in side]
    assert np.abs(20 * np.log10(near[1:] / near[0])).max() < 0.05


@pytest.mark.slow
def test_the_interaural_delay_is_that_of_its_radius_and_ears() -> None:
    """At low frequencies, where the pinna adds the same to both ears: from the sphere's closed form."""
    frequency = np.array([200.0, 300.0])
    for seed, split in ((0, "train"), (1, "test")):
        head = draw_head(split, np.random.default_rng(seed))
        found = parametric_head(head)
        for azimuth in (-70, 25, 90, 140):
            arrivals = Arrivals(
                np.array([0.05]), towards(azimuth).astype(np.float32), np.ones((1, 8), dtype=np.float32)
            )
            response = found.response(arrivals, np.eye(3), RATE).astype(np.float64)
            heard = response @ np.exp(-2j * np.pi * np.outer(np.arange(response.shape[1]) / RATE, frequency))
            theta = np.arccos(ear_axes(head) @ towards(azimuth)[0])
            exact = sphere_response(theta, 2 * np.pi * frequency * head.radius / SPEED_OF_SOUND)
            off = np.angle(heard[1] * np.conj(heard[0]) * np.conj(exact[1] * np.conj(exact[0]))) / (
                2 * np.pi * frequency
            )
            assert np.abs(off).max() < 25e-6, f"{azimuth}°: {off * 1e6} µs"


@pytest.mark.slow
def test_ears_mirror_each_other_and_hear_near_sources() -> None:
    found = parametric_head(a_head())

    def levels(azimuth: float, spherical: bool) -> np.ndarray:
        near = Arrivals(
            np.array([0.5 / SPEED_OF_SOUND]),
            towards(azimuth).astype(np.float32),
            np.full((1, 8), 2.0, dtype=np.float32),
            np.array([spherical]),
        )
        return 10 * np.log10(np.sum(found.response(near, np.eye(3), RATE).astype(np.float64) ** 2, axis=1))

    assert levels(50, False)[::-1] == pytest.approx(levels(-50, False), abs=0.6)
    left, right = levels(90, True) - levels(90, False)
    assert right > 1.0
    assert left < -0.5


# Who shares a head
def test_variants_and_siblings_share_a_head_and_others_do_not(tmp_path: Path) -> None:
    one, variant, other, scene, sibling = heads(plans(tmp_path, hrtf="family", audio="tracer"))
    assert one == variant != other
    assert scene == sibling
    assert len({one.radius, other.radius, scene.radius}) == 3
    assert all(is_of(head, "train") for head in (one, other, scene))
    assert all(is_of(head, "test") for head in heads(plans(tmp_path, hrtf="family-test")))


def test_the_command_line_wins_over_the_manifest_and_digests_tell(tmp_path: Path) -> None:
    plain = plans(tmp_path)
    assert heads(plain) == [None] * 5
    assert [plan.digest for plan in plans(tmp_path, "hrtf: sphere")] == [plan.digest for plan in plain]
    assert [plan.digest for plan in plans(tmp_path, "hrtf: family", hrtf="sphere")] == [plan.digest for plan in plain]
    family = plans(tmp_path, "hrtf: family")
    assert heads(family) == heads(plans(tmp_path, hrtf="family"))
    assert [plan.digest for plan in family] == [plan.digest for plan in plans(tmp_path, hrtf="family")]
    assert not {plan.digest for plan in family} & {plan.digest for plan in plain}
    # Another engine has its own head.
    analytic = plans(tmp_path, "hrtf: family", audio="analytic")
    assert [plan.digest for plan in analytic] == [plan.digest for plan in plans(tmp_path, audio="analytic")]
    # A run that made the sphere's sound is made again with it, whatever the manifest says.
    asked = replace(OWN_HEAD, chosen=True)
    assert heads(plans(tmp_path, "hrtf: family", receivers=asked)) == [None] * 5


def test_a_wrong_head_gets_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Avs3dError, match=r"hrtf: .*'sphere', 'family', 'family-test' or 'kemar'"):
        plans(tmp_path, "hrtf: familly")
    with pytest.raises(UsageError, match=r"^--hrtf needs the engine tracer, found analytic: add --audio tracer$"):
        plans(tmp_path, hrtf="family", audio="analytic")
    monkeypatch.setattr(chosen_receivers, "_KEMAR_FILES", (str(tmp_path / "kemar.sofa"),))
    with pytest.raises(
        Avs3dError, match=r"^--hrtf kemar: no file .*kemar\.sofa; install it .*libmysofa1.*--hrtf FILE$"
    ):
        choose_receivers("tracer", hrtf="kemar")


def test_an_installed_kemar_is_read_as_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("h5py")
    from tests.support.sofa_files import write_sphere

    path = write_sphere(tmp_path / "kemar.sofa", 100)
    monkeypatch.setattr(chosen_receivers, "_KEMAR_FILES", (str(tmp_path / "missing.sofa"), str(path)))
    found = choose_receivers("tracer", hrtf="kemar")
    assert found.hrtf == path
    assert found.hrtf_sha256 == head_identity("kemar") == head_identity(path)
    assert [head_identity(word) for word in (None, "sphere", *FAMILIES)] == [None, "sphere", "family", "family-test"]


def test_identities_are_json() -> None:
    drawn = choose_receivers("tracer", hrtf="family").for_observation(np.random.default_rng(0))
    assert json.loads(json.dumps(drawn.identity()))["head"][0] == "family"
    assert "head" not in OWN_HEAD.identity()
