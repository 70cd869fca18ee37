"""Manifest and assets to dataset.

    from generators import generate, read_manifest

    generate("scenes_manifest/demo.yaml", "data/demo")

The story of one observation is in `generators.observation.generate`. The public names are listed in `__init__.pyi`;
importing this package imports nothing: names are imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
