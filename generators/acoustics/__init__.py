"""Room acoustics: by itself for any room, and as the acoustic backends of the generator.

    from generators import acoustics

    room = acoustics.Room.shoebox((6, 2.7, 4), {"walls": "plaster", "floor": "parquet", "ceiling": "plaster"})
    rir = acoustics.Tracer(seed=1).response(room, source=(1, 1.5, 2), listener=(4, 1.5, 2))
    rir.save("room.wav")

The public names are listed in `__init__.pyi`; importing this package imports nothing: names are imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
