"""Building blocks of the synthesised sounds: signals, voices, loudness."""
