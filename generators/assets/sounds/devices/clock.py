"""The voices of clocks."""

from __future__ import annotations

from collections.abc import Callable

from numpy.random import Generator

from generators.assets.sounds.devices import clock_electric as electric
from generators.assets.sounds.devices import clock_escapements as escapements
from generators.assets.sounds.signals import Array
from generators.assets.sounds.voice import Split, Voice

_RAWLINGS = "A. L. Rawlings, The Science of Clocks and Watches (2nd ed. 1948)"
_HEADRICK = "M. V. Headrick, IEEE Control Systems Magazine 22 (2002) 41–52"
_ROSSING = "N. H. Fletcher, T. D. Rossing, The Physics of Musical Instruments (2nd ed. 1998)"
_LAVET = "M. Lavet, patent FR 823 395 (1936)"
_TIMING = "relation of lift angle and amplitude that timing machines use"
_WARREN = "H. E. Warren's self-starting synchronous motor (1918)"


def _voice(name: str, split: Split, mechanism: str, source: str, play: Callable[[int, Generator], Array]) -> Voice:
    return Voice("clock", name, split, mechanism, source, play)


VOICES: tuple[Voice, ...] = (
    _voice("longcase", "train", "pendulum with recoil escapement", _HEADRICK, escapements.longcase),
    _voice("wall_quartz", "train", "quartz stepper", _LAVET, electric.wall_quartz),
    _voice("kitchen_timer", "train", "balance with pin lever", _TIMING, escapements.kitchen_timer),
    _voice("mantel_striking", "train", "pendulum and gong", _ROSSING, escapements.mantel_striking),
    _voice("twin_bell_alarm", "train", "balance and bells", _ROSSING, escapements.twin_bell_alarm),
    _voice("synchronous", "train", "synchronous motor", _WARREN, electric.synchronous),
    _voice("sweep_quartz", "validation", "quartz stepper", _LAVET, electric.sweep_quartz),
    _voice("cuckoo", "test", "pendulum and bellows", _ROSSING, escapements.cuckoo),
    _voice("flip", "test", "synchronous motor and falling leaves", _WARREN, electric.flip),
    _voice("carriage_lever", "test", "balance with jewelled lever", _RAWLINGS, escapements.carriage_lever),
)
