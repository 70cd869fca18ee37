"""Code that was written for the audio sensor of habitat-sim (SoundSpaces 2.0), on our tracer.

    python examples/habitat_sensor.py

The lines with `sensor` and `spec` are those of habitat-sim's audio_agent.py; the simulator is not needed.
"""

import numpy as np

from generators import acoustics
from generators.acoustics import habitat


def main() -> None:
    """Hear a source from two poses."""
    spec = habitat.AudioSensorSpec()
    spec.uuid = "audio_sensor"
    spec.channelLayout.channelType = habitat.ChannelLayoutType.Binaural
    spec.channelLayout.channelCount = 2
    spec.acousticsConfig.sampleRate = 16_000
    spec.acousticsConfig.indirectRayCount = 500  # has no effect here

    # In habitat-sim the scene is the simulator's; here it is a room, or the file of a mesh.
    room = acoustics.Room.shoebox((6, 2.7, 4), {"walls": "plaster", "floor": "parquet", "ceiling": "plaster"})
    sensor = habitat.AudioSensor(spec, room)
    sensor.setAudioSourceTransform(np.array([1.0, 1.5, 2.0]))
    for yaw, rotation in ((0, [1, 0, 0, 0]), (180, [0, 0, 1, 0])):  # (w, x, y, z)
        sensor.setAudioListenerTransform(np.array([4.0, 1.5, 2.0]), np.array(rotation))
        sensor.runSimulation(None)
        response = np.array(sensor.getIR())
        left, right = np.square(response).sum(axis=1)
        print(f"yaw {yaw:3}: {response.shape[0]} channels, left − right {10 * np.log10(left / right):+.1f} dB")


if __name__ == "__main__":
    main()
