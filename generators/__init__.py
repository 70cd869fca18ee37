"""Manifest and assets to dataset.

    from generators import generate, read_manifest

    generate("scenes_manifest/demo.yaml", "data/demo")

A home by itself, without a manifest (docs/homes.md):

    from generators import Home, Renderer, objects

    scene = Home.apartment(seed=7).place(objects.build("microwave", seed=3), on="worktop", room="kitchen", rng=1)
    frame = Renderer(scene).frame(scene.look_at(1))

The story of one observation is in `generators.observation.generate`. The public names are listed in `__init__.pyi`;
importing this package imports nothing: names are imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
