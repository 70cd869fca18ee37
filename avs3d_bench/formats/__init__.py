"""Files on disk: pictures, sound, meshes, camera models, YAML and archives, read with limits and written atomically."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["media"])
