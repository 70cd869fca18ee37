"""The voices of categories that are heard from other rooms only; they belong to none of the seven."""

from __future__ import annotations

from functools import partial

from generators.assets.sounds.devices import off_screen_animate as animate
from generators.assets.sounds.devices import off_screen_machines as machines
from generators.assets.sounds.devices import off_screen_music as music
from generators.assets.sounds.devices import off_screen_street as street
from generators.assets.sounds.voice import Voice

_KLATT = "Klatt, JASA 67 (1980) 971; vowels of Peterson & Barney, JASA 24 (1952) 175"
_PUMP = "P. L. Timár (ed.), Noise and Vibration of Electrical Machines (1989), on slip and force at twice the mains"
_ROAD = "U. Sandberg, The multi-coincidence peak around 1000 Hz in tyre/road noise spectra, Euronoise 2003"
_BARK = "S. Yin & B. McCowan, Animal Behaviour 68 (2004) 343; T. Riede & T. Fitch, J. Exp. Biol. 202 (1999) 2859"
_FAN = "dipole noise of fans, blade-passing tones: Bies & Hansen, Engineering Noise Control, chapter on sources"

_COMMUTATION = (
    "R. Carlson, M. Lajoie-Mazenc, J. C. dos S. Fagundes, Analysis of torque ripple due to phase commutation in "
    "brushless DC machines, IEEE Trans. Industry Applications 28 (1992) 632–638"
)
_DRAIN = "J. Lladó-París & B. Sánchez-Tabuenca, Acoustic analysis of the drainage cycle in a washing machine, DYNA 82"
_BOILING = "stages of boiling: S. Nukiyama (1934); M. Minnaert's bubbles (1933)"
_WHISTLE = "R. Henrywood & A. Agarwal, The aeroacoustics of a steam kettle, Physics of Fluids 25 (2013) 107101"
_BYRNE = "D. Byrne et al., JASA 96 (1994) 2108 (long-term spectrum); " + _KLATT
_ORGAN = (
    "L. Hammond, Electrical musical instrument, patent US 1 956 350 (1934); J. Smith, S. Serafin, J. Abel, D. Berners, "
    "Doppler simulation and the Leslie, DAFx (2002)"
)
_DRUM = "N. H. Fletcher, T. D. Rossing, The Physics of Musical Instruments (2nd ed. 1998), chapter 3: membranes"
_STIFF = "H. Fletcher, Normal vibration frequencies of a stiff piano string, JASA 36 (1964) 203"
_RAIL = "D. Thompson, Railway Noise and Vibration (2009), chapters on rolling noise, impacts and curve squeal"
_PLUCK = "K. Karplus & A. Strong, Computer Music Journal 7 (1983) 43; D. Jaffe & J. Smith, ibid. 56"

_dishwasher, _fan, _kettle = (partial(Voice.of, name) for name in ("dishwasher", "fan", "kettle"))
_speech, _dog = (partial(Voice.of, name) for name in ("speech_babble", "dog"))
_music, _street = (partial(Voice.of, name) for name in ("music", "street"))

VOICES: tuple[Voice, ...] = (
    _dishwasher(machines.spray_arms, "train", "induction pump and turning jets", _PUMP),
    _dishwasher(machines.tabletop_one_arm, "train", "synchronous pump, one arm, thin door", _DRAIN),
    _dishwasher(machines.inverter_two_arms, "validation", "brushless pump, arms in turn", _COMMUTATION),
    _dishwasher(machines.drain_and_fill, "test", "synchronous drain pump, inlet valve", _DRAIN),
    _fan(machines.desk_axial, "train", "axial blades on a shaded-pole motor", _FAN),
    _fan(machines.duct_extractor, "train", "centrifugal wheel and a duct", _FAN),
    _fan(machines.ceiling_slow, "validation", "slow blades that wobble", _FAN),
    _fan(machines.tower_crossflow, "test", "cross-flow impeller", _FAN),
    _kettle(machines.electric_jug, "train", "collapsing, then rising bubbles of steam", _BOILING),
    _kettle(machines.urn_simmering, "train", "collapsing bubbles under a thermostat", _BOILING),
    _kettle(machines.pan_with_lid, "validation", "rolling boil, lid", "Minnaert's bubbles (1933)"),
    _kettle(machines.stove_whistle, "test", "steam through two plates", _WHISTLE),
    _speech(animate.room_talk, "train", "formants, turn taking", _KLATT),
    _speech(animate.one_sided_call, "train", "formants, one talker with pauses", _KLATT),
    _speech(animate.radio_talk, "validation", "formants, small radio", _KLATT),
    _speech(animate.crowd, "test", "noise with the spectrum and modulation of speech, and some talkers", _BYRNE),
    _dog(animate.large_bark, "train", "larynx and tract, harsh", _BARK),
    _dog(animate.howl_and_bay, "train", "larynx and tract, sustained", _BARK),
    _dog(animate.whine_and_bark, "validation", "whines, growls, barks", _BARK),
    _dog(animate.small_yap, "test", "larynx and tract, tonal", _BARK),
    _music(music.organ_chords, "train", "additive chords", _ORGAN),
    _music(music.struck_strings, "train", "partials of struck stiff strings", _STIFF),
    _music(music.drums_and_bass, "validation", "struck membranes, noise", _DRUM),
    _music(music.plucked_strings, "test", "string loop with a filter", _PLUCK),
    _street(street.passing_cars, "train", "rolling tyres, passing", _ROAD),
    _street(street.tram_line, "train", "steel wheels on rails", _RAIL),
    _street(street.closed_window, "validation", "traffic through a pane", _ROAD),
    _street(street.wet_road_engines, "test", "splashing tyres, firing engines", _ROAD),
)
