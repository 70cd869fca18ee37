"""Mono source signals, by a synthesised voice or from a recording, at a common loudness.

All sources have the same integrated loudness (ITU-R BS.1770-4) and a limited true peak, so that no category is louder
than another and, with the clips' fixed gain, none clips.
"""

from generators.assets.sounds.library import SECOND_FLOOR_DB, find_voice, synthesise, usual_voices, voices
from generators.assets.sounds.loudness import CEILING_DB, TARGET_LUFS
from generators.assets.sounds.recordings import SoundSurvey, load_sound, loop, recorded_seconds, survey
from generators.assets.sounds.stretches import enough, stretches, stretches_in
from generators.assets.sounds.voice import Voice

__all__ = [
    "CEILING_DB",
    "SECOND_FLOOR_DB",
    "TARGET_LUFS",
    "SoundSurvey",
    "Voice",
    "enough",
    "find_voice",
    "load_sound",
    "loop",
    "recorded_seconds",
    "stretches",
    "stretches_in",
    "survey",
    "synthesise",
    "usual_voices",
    "voices",
]
