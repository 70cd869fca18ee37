"""Where objects stand in a room."""
