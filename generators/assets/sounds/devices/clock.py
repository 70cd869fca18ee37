"""The voices of clocks."""

from __future__ import annotations

from functools import partial

from generators.assets.sounds.devices import clock_electric as electric
from generators.assets.sounds.devices import clock_escapements as escapements
from generators.assets.sounds.voice import Voice

_RAWLINGS = "A. L. Rawlings, The Science of Clocks and Watches (2nd ed. 1948)"
_HEADRICK = "M. V. Headrick, IEEE Control Systems Magazine 22 (2002) 41–52"
_ROSSING = "N. H. Fletcher, T. D. Rossing, The Physics of Musical Instruments (2nd ed. 1998)"
_LAVET = "M. Lavet, patent FR 823 395 (1936)"
_WARREN = "H. E. Warren's self-starting synchronous motor (1918)"


_voice = partial(Voice.of, "clock")

VOICES: tuple[Voice, ...] = (
    _voice(escapements.longcase, "train", "pendulum with recoil escapement", _HEADRICK),
    _voice(electric.wall_quartz, "train", "quartz stepper", _LAVET),
    _voice(escapements.kitchen_timer, "train", "balance with pin lever", _RAWLINGS),
    _voice(escapements.mantel_striking, "train", "pendulum and gong", _ROSSING),
    _voice(escapements.twin_bell_alarm, "train", "balance and bells", _ROSSING),
    _voice(electric.synchronous, "train", "synchronous motor", _WARREN),
    _voice(electric.sweep_quartz, "validation", "quartz stepper", _LAVET),
    _voice(escapements.cuckoo, "test", "pendulum and bellows", _ROSSING),
    _voice(electric.flip, "test", "synchronous motor and falling leaves", _WARREN),
    _voice(escapements.carriage_lever, "test", "balance with jewelled lever", _RAWLINGS),
    _voice(electric.bedside_quartz, "train", "quartz stepper", _LAVET),
    _voice(electric.buzzer_alarm, "train", "synchronous motor and reed", _WARREN),
    _voice(electric.kitchen_quartz, "train", "quartz stepper", _LAVET),
)
