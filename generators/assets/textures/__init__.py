"""Procedural textures: sRGB images (H, W, 3) uint8, row 0 at the top, from a `numpy.random.Generator`.

Those with a relief are a `maps.Surface`: the same noise gives their colour and their height in metres.

Every image of `wood`, `ceramic`, `surfaces` and `cloth` (but `cloth.rug`) repeats without a seam; those of `pictures`
and rugs are fitted once over a face. The mean linear albedo is between 0.03 and 0.85, so that indirect light is as
strong as in a real flat.
"""

from generators.assets.textures import ceramic, cloth, maps, noise, pictures, surfaces, wood

__all__ = ["ceramic", "cloth", "maps", "noise", "pictures", "surfaces", "wood"]
