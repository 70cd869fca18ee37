"""The voices of telephones: bells, tone ringers, loudspeakers, a vibrating motor.

Cadences are those of the national networks (ITU-T E.180, supplement 2: various tones used in national networks), with
the tolerance of an exchange. The pauses hold the faint sound of a room (`room_tone`).
"""

from __future__ import annotations

from generators.assets.sounds.devices import telephone_bells as bells
from generators.assets.sounds.devices import telephone_mobile as mobile
from generators.assets.sounds.devices import telephone_tones as tones
from generators.assets.sounds.devices import telephone_vibration as vibration
from generators.assets.sounds.voice import Voice

_BELL = "polarised ringer with gongs"
_CHIP = "tone-ringer circuit with piezo disc or loudspeaker"
_SYNTHESIS = "synthesised melody through a small loudspeaker"
_SHELL = "ring modes of shells: Rayleigh, The Theory of Sound (1894), chapter X A; contact of a hammer: half-sine force"
_CADENCE = "cadence: ITU-T E.180 supplement 2"

VOICES: tuple[Voice, ...] = (
    Voice("telephone", "uk_desk_bell", "train", _BELL, f"{_SHELL}; {_CADENCE} (GB)", bells.uk_desk_bell),
    Voice(
        "telephone",
        "wall_single_gong",
        "train",
        "single gong struck from inside, chattering clapper",
        f"{_SHELL}; {_CADENCE} (DE, FR)",
        bells.wall_single_gong,
    ),
    Voice(
        "telephone",
        "ringer_ic_piezo",
        "train",
        _CHIP,
        "datasheet STMicroelectronics LS1240A (1998): f2 = 0.725 f1, sweep = 750/C1(nF) Hz",
        tones.ringer_ic_piezo,
    ),
    Voice(
        "telephone",
        "cordless_polyphonic",
        "train",
        _SYNTHESIS,
        "J. Chowning, The synthesis of complex audio spectra by means of frequency modulation, JAES 21 (1973)",
        mobile.cordless_polyphonic,
    ),
    Voice(
        "telephone",
        "mobile_buzzer_melody",
        "train",
        "square wave through a magnetic buzzer",
        "F. V. Hunt, Electroacoustics (1954), on moving-armature transducers; resonances of 2.0 to 3.1 kHz: catalogues",
        mobile.mobile_buzzer_melody,
    ),
    Voice(
        "telephone",
        "mobile_vibration_wood",
        "train",
        "vibration motor that makes the telephone hop on wood",
        "Precision Microdrives AB-029 (frequency and force against voltage); a ball on a shaken plate: "
        "N. Tufillaro, T. Abbott, J. Reilly, An Experimental Approach to Nonlinear Dynamics and Chaos (1992)",
        mobile.mobile_vibration_wood,
    ),
    Voice(
        "telephone",
        "ringer_ic_speaker",
        "validation",
        _CHIP,
        "datasheet Motorola MC34012: tones f0/4 and f0/5, warble f0/320 or f0/640",
        tones.ringer_ic_speaker,
    ),
    Voice("telephone", "us_desk_bell", "test", _BELL, f"{_SHELL}; {_CADENCE} (US), 20 Hz", bells.us_desk_bell),
    Voice(
        "telephone",
        "voip_office",
        "test",
        "stored waveform at 8 kHz, companded, through a desk set's loudspeaker",
        "ITU-T G.711 (1988) companding; rings and pauses of the stored file",
        tones.voip_office,
    ),
    Voice(
        "telephone",
        "smartphone_marimba",
        "test",
        _SYNTHESIS,
        "tuned bars, modes 1 : 4 : 9.5: Fletcher & Rossing, The Physics of Musical Instruments (1998), chapter 19",
        mobile.smartphone_marimba,
    ),
    Voice(
        "telephone",
        "warbling_caller",
        "train",
        "gated oscillator",
        f"tone caller of the British Telephone No. 712 (1965); {_CADENCE}",
        tones.warbling_caller,
    ),
    Voice(
        "telephone", "sampled_bell", "train", "recorded bell through a small loudspeaker", _SHELL, bells.sampled_bell
    ),
    Voice(
        "telephone",
        "smartphone_on_stone",
        "train",
        "linear resonant actuator that makes the telephone chatter on a hard table",
        "Precision Microdrives AB-020 (linear resonant actuators); P. J. Holmes, The dynamics of repeated impacts with "
        "a sinusoidally vibrating table, Journal of Sound and Vibration 84 (1982) 173–189",
        vibration.smartphone_on_stone,
    ),
)
