"""A furnished flat, a microwave on a worktop, a picture of it, and its sound as two ears hear it.

    python examples/hello_home.py hello

Writes picture.png and sound.wav into the folder. The first run builds and lights the flat in half a minute of CPU time
(--light preview: a few seconds), later ones read it from the cache.
"""

import argparse
from pathlib import Path

import cv2

from avs3d_bench.geometry import Intrinsics
from generators import Home, Renderer, objects


def main(folder: Path, light: str, size: int) -> None:
    """Write a picture and a sound into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    home = Home.apartment(seed=7, light=light)
    microwave = objects.build("microwave", seed=3)
    scene = home.place(microwave, on="worktop", room="kitchen", rng=1)
    pose = scene.look_at(1)
    frame = Renderer(scene).frame(pose, Intrinsics.from_fov(size))
    cv2.imwrite(str(folder / "picture.png"), frame.rgb[..., ::-1])
    sound = scene.hear(pose, sounding=1, seconds=4)
    sound.save(folder / "sound.wav")
    share = (frame.instance_ids == 1).mean()
    print(f"{scene!r}: the microwave fills {share:.1%} of the picture; {sound!r}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--light", default="standard")
    parser.add_argument("--size", type=int, default=512)
    main(**vars(parser.parse_args()))
