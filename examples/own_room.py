"""The response of a room of one's own, from a mesh and a table of materials.

    python examples/own_room.py [flat.glb materials.yaml] [--source X Y Z] [--listener X Y Z]

Without a mesh, it makes one.
"""

import argparse
from pathlib import Path

import trimesh

from avs3d_bench import Avs3dError
from generators import acoustics

TABLE = """\
materials:
  my_carpet: {absorption: {125: 0.05, 1000: 0.3, 4000: 0.6}, scattering: 0.3}
surfaces:
  "*": plaster          # names of the table, see acoustics.Room
  "floor*": my_carpet
"""


def made_mesh() -> trimesh.Scene:
    """A room of 5 × 2.5 × 4 m about the origin, its floor a mesh of its own."""
    box = trimesh.creation.box((5, 2.5, 4))
    is_floor = box.face_normals[:, 1] < -0.5
    parts = {name: box.submesh([faces.nonzero()[0]], append=True) for name, faces in
             (("floor_1", is_floor), ("walls", ~is_floor))}  # fmt: skip
    return trimesh.Scene(parts)


def main() -> None:
    """Read the room, say what was matched, trace it, write the response."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", nargs="?")
    parser.add_argument("materials", nargs="?", default="materials.yaml")
    parser.add_argument("--source", nargs=3, type=float, default=(-1.5, 0.2, -0.5))
    parser.add_argument("--listener", nargs=3, type=float, default=(1.5, 0.3, 0.8))
    given = parser.parse_args()
    if given.mesh is None:
        Path(given.materials).write_text(TABLE, encoding="utf-8")
    try:
        room = acoustics.Room.from_mesh(given.mesh or made_mesh(), given.materials)
        for use in room.materials_used():
            print(f"{use.pattern:10} {use.material:10} {use.area:6.1f} m²  {', '.join(use.names)}")
        rir = acoustics.Tracer(seed=1).response(room, given.source, given.listener, sample_rate=48_000)
    except Avs3dError as error:
        raise SystemExit(str(error)) from None
    for octave, seconds in rir.t30().items():
        print(f"{octave:5} Hz: T30 {seconds or float('nan'):.2f} s, DRR {rir.drr()[octave]:+.1f} dB")
    print(rir.save("own_room.wav"))


if __name__ == "__main__":
    main()
