"""White materials in place of those of a flat, for what needs its geometry alone: drawing textures takes longest."""

from __future__ import annotations

import numpy as np

from generators.assets.materials import ROLES, Palette
from generators.core.scene import Material, Texture

#: Roles whose material has no texture. Furniture turns the grain of all others at random, which geometry depends on.
UNTEXTURED = frozenset(
    {
        "accent_paint", "black_glass", "black_metal", "bulb", "ceramic", "ceramic_accent", "chrome", "clear_glass",
        "enamel", "fruit_green", "fruit_orange", "fruit_red", "glass", "hood_light", "lamp_glass", "metal", "mirror",
        "mount_board", "paper", "plastic_black", "plastic_white", "pot", "pot_white", "radiator", "stem", "tap",
        "tone_0", "tone_1", "tone_2", "tone_3", "toy_blue", "toy_green", "toy_red", "toy_yellow",
    }
)  # fmt: skip


class PlainPalette(Palette):
    """White materials; those that have a texture have a small white one."""

    def material(self, role: str) -> Material:
        """The white material of a role (`ROLES`).

        Raises:
            UsageError: if there is no such role.
        """
        if role not in ROLES:
            return super().material(role)
        texture = None if role in UNTEXTURED else Texture(role, np.full((4, 4, 3), 255, dtype=np.uint8))
        return self._made.get(role, lambda: Material(role, "plaster", texture=texture))
