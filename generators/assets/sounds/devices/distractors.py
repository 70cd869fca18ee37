"""Sounds that belong to none of the seven categories: those of silent objects and of what is off-screen."""

from __future__ import annotations

from generators.assets.sounds.devices import distractors_animate as animate
from generators.assets.sounds.devices import distractors_machines as machines
from generators.assets.sounds.devices import distractors_music as music
from generators.assets.sounds.devices import distractors_street as street
from generators.assets.sounds.voice import Voice

_KLATT = "Klatt, JASA 67 (1980) 971; vowels of Peterson & Barney, JASA 24 (1952) 175"
_PUMP = "induction motors: slip of 2 to 6 %, force at twice the mains frequency (textbooks of electrical machines)"
_ROAD = "U. Sandberg, The multi-coincidence peak around 1000 Hz in tyre/road noise spectra, Euronoise 2003"
_BARK = "S. Yin & B. McCowan, Animal Behaviour 68 (2004) 343; T. Riede & T. Fitch, J. Exp. Biol. 202 (1999) 2859"
_FAN = "dipole noise of fans, blade-passing tones: Bies & Hansen, Engineering Noise Control, chapter on sources"

DISTRACTORS: tuple[Voice, ...] = (
    Voice("dishwasher", "spray_arms", "train", "induction pump and turning jets", _PUMP, machines.spray_arms),
    Voice(
        "dishwasher",
        "inverter_two_arms",
        "validation",
        "brushless pump, arms in turn",
        "six-step commutation: ripple at six times the electrical frequency",
        machines.inverter_two_arms,
    ),
    Voice(
        "dishwasher",
        "drain_and_fill",
        "test",
        "synchronous drain pump, inlet valve",
        "J. Lladó-París & B. Sánchez-Tabuenca, Acoustic analysis of the drainage cycle in a washing machine, DYNA 82",
        machines.drain_and_fill,
    ),
    Voice("fan", "desk_axial", "train", "axial blades on a shaded-pole motor", _FAN, machines.desk_axial),
    Voice("fan", "ceiling_slow", "validation", "slow blades that wobble", _FAN, machines.ceiling_slow),
    Voice("fan", "tower_crossflow", "test", "cross-flow impeller", _FAN, machines.tower_crossflow),
    Voice(
        "kettle",
        "electric_jug",
        "train",
        "collapsing, then rising bubbles of steam",
        "stages of boiling: S. Nukiyama (1934); M. Minnaert's bubbles (1933)",
        machines.electric_jug,
    ),
    Voice(
        "kettle", "pan_with_lid", "validation", "rolling boil, lid", "Minnaert's bubbles (1933)", machines.pan_with_lid
    ),
    Voice(
        "kettle",
        "stove_whistle",
        "test",
        "steam through two plates",
        "R. Henrywood & A. Agarwal, The aeroacoustics of a steam kettle, Physics of Fluids 25 (2013) 107101",
        machines.stove_whistle,
    ),
    Voice("speech_babble", "room_talk", "train", "formants, turn taking", _KLATT, animate.room_talk),
    Voice("speech_babble", "radio_talk", "validation", "formants, small radio", _KLATT, animate.radio_talk),
    Voice(
        "speech_babble",
        "crowd",
        "test",
        "noise with the spectrum and modulation of speech, and some talkers",
        "D. Byrne et al., JASA 96 (1994) 2108 (long-term spectrum); " + _KLATT,
        animate.crowd,
    ),
    Voice("dog", "large_bark", "train", "larynx and tract, harsh", _BARK, animate.large_bark),
    Voice("dog", "whine_and_bark", "validation", "whines, growls, barks", _BARK, animate.whine_and_bark),
    Voice("dog", "small_yap", "test", "larynx and tract, tonal", _BARK, animate.small_yap),
    Voice(
        "music", "organ_chords", "train", "additive chords", "drawbar registration: sines at 1 to 8", music.organ_chords
    ),
    Voice(
        "music", "drums_and_bass", "validation", "struck membranes, noise", "modes of an ideal membrane", music.drums
    ),
    Voice(
        "music",
        "plucked_strings",
        "test",
        "string loop with a filter",
        "K. Karplus & A. Strong, Computer Music Journal 7 (1983) 43; D. Jaffe & J. Smith, ibid. 56",
        music.plucked_strings,
    ),
    Voice("street", "passing_cars", "train", "rolling tyres, passing", _ROAD, street.passing_cars),
    Voice("street", "closed_window", "validation", "traffic through a pane", _ROAD, street.closed_window),
    Voice("street", "wet_road_engines", "test", "splashing tyres, firing engines", _ROAD, street.wet_road_engines),
)
