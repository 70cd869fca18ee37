"""The voices of washing machines."""

from __future__ import annotations

from collections.abc import Callable

from numpy.random import Generator

from generators.assets.sounds.devices import washing_machine_drums as drums
from generators.assets.sounds.devices import washing_machine_tubs as tubs
from generators.assets.sounds.signals import Array
from generators.assets.sounds.voice import Split, Voice

_GIERAS = "J. F. Gieras, C. Wang, J. C. Lai, Noise of Polyphase Electric Motors (2006)"
_TIMAR = "P. L. Timár (ed.), Noise and Vibration of Electrical Machines (1989)"
_CONRAD = "D. C. Conrad, W. Soedel, Journal of Sound and Vibration 188 (1995) 301–314"
_MCFADDEN = "P. D. McFadden, J. D. Smith, Journal of Sound and Vibration 96 (1984) 69–82"
_SCHEMMANN = "H. Schemmann, dissertation, Eindhoven (1971), on single-phase synchronous motors"
_HOLMES = "P. J. Holmes, Journal of Sound and Vibration 84 (1982) 173–189, on bouncing"


def _voice(name: str, split: Split, mechanism: str, source: str, play: Callable[[int, Generator], Array]) -> Voice:
    return Voice("washing_machine", name, split, mechanism, source, play)


VOICES: tuple[Voice, ...] = (
    _voice("universal_belt", "train", "universal motor and belt", _CONRAD, drums.universal_belt),
    _voice("direct_drive", "train", "permanent-magnet motor without gear", _GIERAS, drums.direct_drive),
    _voice("inverter_belt", "train", "permanent-magnet motor and belt", _GIERAS, drums.inverter_belt),
    _voice("two_speed_filling", "train", "induction motor and water inlet", _TIMAR, drums.two_speed_filling),
    _voice("drain_pump", "train", "synchronous pump", _SCHEMMANN, drums.drain_pump),
    _voice("agitator_gearcase", "train", "induction motor and gearcase", _TIMAR, tubs.agitator_gearcase),
    _voice("impeller_direct", "validation", "permanent-magnet motor without gear", _GIERAS, tubs.impeller_direct),
    _voice("twin_tub", "test", "induction motor and pulsator", _TIMAR, tubs.twin_tub),
    _voice("walking_spin", "test", "universal motor and belt", _HOLMES, drums.walking_spin),
    _voice("worn_bearing", "test", "defective rolling bearing", _MCFADDEN, drums.worn_bearing),
)
