"""The listener: a small network that looks and listens, trained on datasets of this project's own generator.

    from baselines.listener import load_listener, write_listener

`model` is the network on one page, `features` and `direction` are what it hears, `shards` and `batches` what it is
trained on, `training` how. The public names are listed in `__init__.pyi`; they are imported on first use.

Examples:
    >>> from avs3d_bench import Dataset
    >>> from baselines import listener
    >>> method = listener.load_method("weights/listener.safetensors", device="cpu", looks="one")
    >>> writer = listener.write_listener(Dataset("data/demo"), "heard", method, only=["part_1/*"], overwrite=True)
    >>> sorted(path.name for path in writer.path.rglob("*.png"))
    ['frame_000.png', 'frame_008.png']
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
