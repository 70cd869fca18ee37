"""Room acoustics: by itself for any room, and as the acoustic backends of the generator.

The public names are listed in `__init__.pyi`; importing this package imports nothing: names are imported on first use.

Examples:
    >>> from generators import acoustics
    >>> room = acoustics.Room.shoebox((6, 2.7, 4), {"walls": "plaster", "floor": "parquet", "ceiling": "plaster"})
    >>> rir = acoustics.Tracer(seed=1).response(room, source=(1, 1.5, 2), listener=(4, 1.5, 2))
    >>> rir.samples.shape[0], rir.sample_rate  # two ears
    (2, 44100)
    >>> round(rir.t30()[1000], 1)  # seconds, in the octave at 1 kHz
    1.0
    >>> rir.save("room.wav").name
    'room.wav'
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
