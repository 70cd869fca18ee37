"""The voices of clocks."""

from generators.assets.sounds.voice import Voice

VOICES: tuple[Voice, ...] = ()
