"""Questions about what is heard, with exact answers, from groups of siblings: `avs3d export qa`."""
