"""Clutter: the small things of a lived-in home, as a catalogue (`catalogue.CLUTTER`) of builders and places."""
