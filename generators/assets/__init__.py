"""Assets: shapes, textures, furniture, objects, sounds."""
