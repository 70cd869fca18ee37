"""Furnishing rooms: where pieces may stand, and the rules of each kind of room."""
