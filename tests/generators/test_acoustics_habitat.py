"""The audio sensor of habitat-sim on our engines: the same calls, the same shapes."""

from __future__ import annotations

import ast
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

from avs3d_bench.errors import Avs3dError
from generators import acoustics
from generators.acoustics import habitat
from generators.acoustics.tracer.settings import TraceSettings

SOURCE, LISTENER, AHEAD = [1.0, 1.5, 2.0], [4.0, 1.5, 2.0], [1, 0, 0, 0]
FEW = TraceSettings(arrivals=500, least_rays=200, most_rays=400, rain_rays=50)


@pytest.fixture(scope="module")
def room() -> acoustics.Room:
    return acoustics.Room.shoebox((6, 2.7, 4), 0.2)


def sensor(room: acoustics.Room, kind: str = "Binaural", channels: int = 2, **config: object) -> habitat.AudioSensor:
    spec = habitat.AudioSensorSpec()
    spec.uuid = "audio_sensor"
    spec.channelLayout.channelType = habitat.ChannelLayoutType[kind]
    spec.channelLayout.channelCount = channels
    spec.acousticsConfig.sampleRate = 16_000
    spec.acousticsConfig.indirectRayCount = 500  # of the other engine
    for name, value in config.items():
        setattr(spec.acousticsConfig, name, value)
    made = habitat.AudioSensor(spec, room, acoustics.Tracer(settings=FEW))
    made.setAudioSourceTransform(np.array(SOURCE))
    made.setAudioListenerTransform(np.array(LISTENER), np.array(AHEAD))
    return made


@pytest.mark.parametrize(("kind", "channels"), [("Mono", 1), ("Binaural", 2), ("Ambisonics", 4)])
def test_the_response_is_a_list_of_channels(room: acoustics.Room, kind: str, channels: int) -> None:
    made = sensor(room, kind, channels)
    made.runSimulation(None)
    found = np.array(made.getIR())
    assert found.shape == (channels, made.rir.samples.shape[1])
    np.testing.assert_array_equal(found.astype(np.float32), made.get_observation())
    assert np.abs(found).max() < 0.25 / 3 * 2.5  # the volume of habitat-sim, 3 m


def test_a_source_on_the_left_is_louder_left(room: acoustics.Room) -> None:
    made = sensor(room, globalVolume=1.0)  # the source is at −X of a listener who faces −Z
    assert made.sourceIsVisible()
    left, right = np.square(made.get_observation()).sum(axis=1)
    assert left > 1.2 * right
    made.setAudioListenerTransform(LISTENER, [0, 0, 1, 0])  # turned about
    left, right = np.square(made.get_observation()).sum(axis=1)
    assert right > 1.2 * left


def test_direct_and_indirect_sound_add_up(room: acoustics.Room) -> None:
    whole, direct, indirect = (
        sensor(room, "Mono", 1, direct=a, indirect=b).get_observation()[0] for a, b in ((1, 1), (1, 0), (0, 1))
    )
    count = len(direct)
    assert count < len(whole)
    np.testing.assert_allclose(whole[:count], direct + indirect[:count], atol=1e-3 * np.abs(whole).max())


def test_what_is_missing_or_unknown_is_said(room: acoustics.Room, tmp_path: Path) -> None:
    made = habitat.AudioSensor(habitat.AudioSensorSpec(), room)
    with pytest.raises(Avs3dError, match="no response yet"):
        made.getIR()
    with pytest.raises(Avs3dError, match="call setAudioSourceTransform and setAudioListenerTransform first"):
        made.runSimulation()
    with pytest.raises(Avs3dError, match="Binaural with 3 channels"):
        sensor(room, channels=3)
    with pytest.raises(AttributeError, match="sampleRte"):
        made.spec.acousticsConfig.sampleRte = 1
    path = tmp_path / "box.glb"
    trimesh.Scene({"wall": trimesh.creation.box((6, 2.7, 4))}).export(path)
    materials = tmp_path / "materials.json"
    materials.write_text('{"materials": [{"name": "hard", "labels": ["wall"], "absorption": [125, 0.01]}]}')
    by_file = habitat.AudioSensor(habitat.AudioSensorSpec(), path, acoustics.Analytic())
    by_file.setAudioSourceTransform([0, 0, 0])
    by_file.setAudioListenerTransform([1, 0, 1], AHEAD)
    soft = by_file.get_observation()
    by_file.setAudioMaterialsJSON(materials)
    assert np.square(by_file.get_observation()).sum() > 2 * np.square(soft).sum()


def test_habitat_sims_own_code_runs_on_it(room: acoustics.Room) -> None:
    """The method of habitat-sim's simulator that reads its audio sensor, run as it is on ours."""
    python = os.environ.get("AVS3D_HABITAT_PYTHON")
    if not python or not Path(python).is_file():
        pytest.skip("habitat-sim's Python is named by AVS3D_HABITAT_PYTHON")
    (file,) = Path(python).parents[1].glob("lib/python3*/site-packages/habitat_sim/simulator.py")
    tree = ast.parse(file.read_text(encoding="utf-8"))
    (method,) = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) and n.name == "_get_audio_observation")
    method.returns = None
    names: dict[str, Any] = {"np": np, "SensorType": SimpleNamespace(AUDIO="audio")}
    exec(compile(ast.Module([method], []), str(file), "exec"), names)
    made = sensor(room)
    made.node = SimpleNamespace(absolute_translation=np.array(LISTENER))  # type: ignore[attr-defined]
    rotation = SimpleNamespace(w=1.0, x=0.0, y=0.0, z=0.0)
    agent = SimpleNamespace(_sensors={"audio_sensor": made}, state=SimpleNamespace(rotation=rotation))
    caller = SimpleNamespace(_spec=SimpleNamespace(sensor_type="audio"), _agent=agent, _sim=None)
    np.testing.assert_array_equal(np.float32(names["_get_audio_observation"](caller)), sensor(room).get_observation())
