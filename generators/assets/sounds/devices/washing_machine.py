"""The voices of washing machines."""

from __future__ import annotations

from functools import partial

from generators.assets.sounds.devices import washing_machine_drums as drums
from generators.assets.sounds.devices import washing_machine_dryers as dryers
from generators.assets.sounds.devices import washing_machine_loads as loads
from generators.assets.sounds.devices import washing_machine_quiet as quiet
from generators.assets.sounds.devices import washing_machine_tubs as tubs
from generators.assets.sounds.voice import Voice

_GIERAS = "J. F. Gieras, C. Wang, J. C. Lai, Noise of Polyphase Electric Motors (2006)"
_TIMAR = "P. L. Timár (ed.), Noise and Vibration of Electrical Machines (1989)"
_CONRAD = "D. C. Conrad, W. Soedel, Journal of Sound and Vibration 188 (1995) 301–314"
_MCFADDEN = "P. D. McFadden, J. D. Smith, Journal of Sound and Vibration 96 (1984) 69–82"
_SCHEMMANN = "H. Schemmann, dissertation, Eindhoven (1971), on single-phase synchronous motors"
_GUEDEL = "A. Guédel, Fan Acoustics: Noise Generation and Control Methods, AMCA (2007)"
_HOLMES = "P. J. Holmes, Journal of Sound and Vibration 84 (1982) 173–189, on bouncing"
_ROBERTS = "M. E. Roberts et al., ANZIAM Journal 59 (2019) M30–M62, on falling laundry"
_BAE = "S. Bae et al., Journal of Sound and Vibration 257 (2002) 3–18, on balancers; Cremer 1942 (mass law)"


_voice = partial(Voice.of, "washing_machine")

VOICES: tuple[Voice, ...] = (
    _voice(drums.universal_belt, "train", "universal motor and belt", _CONRAD),
    _voice(drums.direct_drive, "train", "permanent-magnet motor without gear", _GIERAS),
    _voice(drums.inverter_belt, "train", "permanent-magnet motor and belt", _GIERAS),
    _voice(drums.two_speed_filling, "train", "induction motor and water inlet", _TIMAR),
    _voice(drums.drain_pump, "train", "synchronous pump", _SCHEMMANN),
    _voice(tubs.agitator_gearcase, "train", "induction motor and gearcase", _TIMAR),
    _voice(tubs.impeller_direct, "validation", "permanent-magnet motor without gear", _GIERAS),
    _voice(tubs.twin_tub, "test", "induction motor and pulsator", _TIMAR),
    _voice(drums.walking_spin, "test", "universal motor and belt", _HOLMES),
    _voice(drums.worn_bearing, "test", "defective rolling bearing", _MCFADDEN),
    _voice(dryers.washer_dryer, "train", "blower over a heater", _GUEDEL),
    _voice(dryers.toploader_hatch, "train", "universal motor and belt", _CONRAD),
    _voice(loads.wet_tumble, "train", "falling wet load", _ROBERTS),
    _voice(loads.built_in_spin, "train", "uneven load behind a door", _BAE),
    _voice(quiet.half_load_splash, "train", "small load in deep water", _ROBERTS),
    _voice(quiet.old_gear_wash, "train", "universal motor and long belt", _CONRAD),
)
