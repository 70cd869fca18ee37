"""The colours and choices of interior styles: plain data that `Palette` picks from.

Each field is a tuple of options, one of which is chosen by the flat's seed; colours are sRGB hex.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Style:
    """The options of one interior style.

    Attributes:
        walls: wall paints of the living rooms.
        accents: paints of a feature wall.
        papers: (motif, ground, ink) of wallpapers; may be empty.
        wall_finish: ``paint``, ``lime`` (rough plaster) or ``brick`` for the feature wall.
        floors: (layout, species) of wooden floors, or ``concrete`` or ``terracotta``.
        wet_floors: (kind, colours) of kitchen and bathroom floors.
        wall_tiles: (kind, colour, grout) of bathrooms and splash-backs.
        wood, wood_alt: species of furniture.
        fronts: kitchen fronts, ``wood:<species>`` or a paint.
        fronts_upper: wall cabinets.
        worktops: ``wood:<species>``, ``granite:<hex>``, ``marble:<hex>``, ``terrazzo:<hex>`` or ``steel:<hex>``.
        metal: handles and lamps.
        tap: taps and rails.
        upholstery: (weave, colour) of sofa and armchair.
        cushions: colours of cushions, throws and prints.
        textiles: colours of curtains.
        bedding: colours of bed covers.
        towels: colours of towels.
        rugs: (pattern, colours).
        art: colours of pictures.
        doors: door leaves, in the notation of ``fronts``.
        frames: window frames.
        skirting: skirting boards and door frames.
        accent_paint: lacquered small furniture.
    """

    walls: tuple[str, ...]
    accents: tuple[str, ...]
    papers: tuple[tuple[str, str, str], ...]
    wall_finish: tuple[str, ...]
    floors: tuple[tuple[str, str], ...]
    wet_floors: tuple[tuple[str, tuple[str, ...]], ...]
    wall_tiles: tuple[tuple[str, str, str], ...]
    wood: tuple[str, ...]
    wood_alt: tuple[str, ...]
    fronts: tuple[str, ...]
    fronts_upper: tuple[str, ...]
    worktops: tuple[str, ...]
    metal: tuple[str, ...]
    tap: tuple[str, ...]
    upholstery: tuple[tuple[str, str], ...]
    cushions: tuple[str, ...]
    textiles: tuple[str, ...]
    bedding: tuple[str, ...]
    towels: tuple[str, ...]
    rugs: tuple[tuple[str, tuple[str, ...]], ...]
    art: tuple[str, ...]
    doors: tuple[str, ...]
    frames: tuple[str, ...]
    skirting: tuple[str, ...]
    accent_paint: tuple[str, ...]


STYLES: dict[str, Style] = {
    "scandinavian": Style(
        walls=("#ebe8e1", "#e6e5e0", "#e9e4da"),
        accents=("#b9c4b6", "#a9b8c0", "#d9c7b4", "#c5ccc4"),
        papers=(("sprigs", "#e9e6de", "#a9b5a4"), ("trellis", "#e6e3dc", "#b7bdbf")),
        wall_finish=("paint",),
        floors=(("strips_wide", "oak_pale"), ("herringbone", "oak_pale"), ("strips", "birch")),
        wet_floors=(
            ("hex", ("#dad8d2", "#c2c4c2", "#a9adac")),
            ("square", ("#b9b8b3", "#98968f")),
            ("terrazzo", ("#dddad2", "#8d857b", "#c6a48f", "#6c7472")),
        ),
        wall_tiles=(
            ("metro", "#e4e3de", "#a5a39d"),
            ("square", "#e2e2dd", "#b5b3ad"),
            ("metro_v", "#b4c3bd", "#d6d6d0"),
        ),
        wood=("oak_pale", "birch", "oak"),
        wood_alt=("oak", "pine"),
        fronts=("#e3e2dd", "#a3b1a6", "wood:birch", "#8fa2ab"),
        fronts_upper=("#e6e5e0",),
        worktops=("wood:oak", "wood:oak_pale", "marble:#e4e2dd"),
        metal=("#3b3b3c", "#b59a63"),
        tap=("#c9cbcc", "#4a4a4b"),
        upholstery=(("weave", "#a5a9aa"), ("boucle", "#dcd5c8"), ("weave", "#8398a3"), ("weave", "#93a08f")),
        cushions=("#d8b26a", "#8fa396", "#c9826a", "#e1dacd", "#5f7684"),
        textiles=("#e2ddd2", "#c9cfcb", "#d5cabb"),
        bedding=("#e3e0d9", "#aebac0", "#d3c4b4"),
        towels=("#e2e0da", "#9fb3ae", "#d2a793", "#7f97a3"),
        rugs=(
            ("berber", ("#e3dccd", "#4a4744", "#8f877c")),
            ("plain", ("#b9b3a7", "#8a8479", "#fff")),
            ("arcs", ("#e3dccd", "#c9a06b", "#8fa396", "#b9705a")),
        ),
        art=("#4f6f7c", "#c98f5a", "#8fa68f", "#d9b67a", "#3d4a50"),
        doors=("#e6e4de",),
        frames=("#eceae5",),
        skirting=("#e9e7e1",),
        accent_paint=("#e5e3dd", "#91a79b", "#d0a56b"),
    ),
    "warm_classic": Style(
        walls=("#e8dfca", "#e4d6bd", "#e5ddcf"),
        accents=("#9c4f3c", "#7d8a63", "#b98d52", "#4d6470"),
        papers=(("damask", "#dccfb4", "#b89f74"), ("stripes", "#e5dac3", "#c4ad82"), ("damask", "#9aa58c", "#b9c0a6")),
        wall_finish=("paint",),
        floors=(("herringbone", "oak"), ("herringbone_straight", "cherry"), ("strips_narrow", "walnut")),
        wet_floors=(
            ("checker", ("#e0d8c8", "#5d5348")),
            ("cement", ("#e0d7c3", "#8c4f3a", "#5f6d58")),
            ("marble", ("#d9cbb4", "#a58a66")),
        ),
        wall_tiles=(
            ("square", "#e3d9c4", "#b8ab93"),
            ("metro", "#d9d4c2", "#9a917f"),
            ("marble", "#dfd3bf", "#a98f6d"),
        ),
        wood=("cherry", "walnut", "mahogany"),
        wood_alt=("oak", "walnut"),
        fronts=("#dcd2bb", "wood:cherry", "#7f8b70", "wood:oak"),
        fronts_upper=("#e0d7c2",),
        worktops=("granite:#6b5648", "wood:walnut", "marble:#ddd3c2"),
        metal=("#b8924d", "#8a6a3c"),
        tap=("#c8b079", "#c9cbcc"),
        upholstery=(("velvet", "#7a3b32"), ("leather", "#7b4a2e"), ("weave", "#b7a27c"), ("velvet", "#44563f")),
        cushions=("#b98d3f", "#8a3d33", "#59663f", "#e0d2b3", "#3f5563"),
        textiles=("#cbb68c", "#a5644c", "#d8ccb0"),
        bedding=("#e0d6c1", "#a9644f", "#b9a77f"),
        towels=("#e1d6c0", "#a9563f", "#8d9670", "#d0b27d"),
        rugs=(
            ("oriental", ("#d9c9a6", "#8a2f2a", "#2f4157")),
            ("worn", ("#cdbb98", "#93483a", "#465a63")),
            ("oriental", ("#c9b58e", "#31465c", "#9a5a35")),
        ),
        art=("#8a4432", "#3e5261", "#b98a3e", "#5e6d4c", "#d9c49a"),
        doors=("wood:cherry", "#e3d9c6", "wood:oak"),
        frames=("#e7e0d0", "wood:cherry"),
        skirting=("#e5dcc8", "wood:oak"),
        accent_paint=("#d9cdb2", "#6d7a5c", "#8f4638"),
    ),
    "modern_dark": Style(
        walls=("#d3d2cf", "#c9c8c5", "#dad7d1"),
        accents=("#4a5055", "#3f4a50", "#57514c", "#5b5f58"),
        papers=(("stripes", "#6d6f70", "#5d5f61"),),
        wall_finish=("paint", "paint", "lime"),
        floors=(("strips_wide", "oak_smoked"), ("concrete", "#8f8d8a"), ("herringbone", "oak_smoked")),
        wet_floors=(
            ("slate", ("#66686a", "#4b4c4d")),
            ("concrete_tile", ("#918f8c", "#73716e")),
            ("terrazzo", ("#8d8c8a", "#d6d3cc", "#4a4a4b", "#b09b86")),
        ),
        wall_tiles=(
            ("marble", "#dcdbd8", "#5c5d61"),
            ("slate", "#77797b", "#575859"),
            ("metro_v", "#4f5659", "#7d7f80"),
        ),
        wood=("walnut", "oak_smoked"),
        wood_alt=("wenge", "ash_grey"),
        fronts=("#4b4e50", "wood:walnut", "#5b6064", "wood:oak_smoked"),
        fronts_upper=("wood:walnut", "#d2d0cc", "#55585a"),
        worktops=("granite:#3f3f41", "marble:#d9d8d5", "granite:#55524e"),
        metal=("#38383a", "#a98a5c"),
        tap=("#47474a", "#c4c6c8"),
        upholstery=(("weave", "#62666a"), ("leather", "#403a36"), ("velvet", "#31514d"), ("boucle", "#b9b4ab")),
        cushions=("#b5793f", "#8d9194", "#d5d1c8", "#2f5550", "#6e4438"),
        textiles=("#8b8c8c", "#5d6264", "#b5b1a9"),
        bedding=("#8c9093", "#d8d5cf", "#55606a"),
        towels=("#6b6f72", "#d7d4ce", "#3f5a5c", "#b07a4a"),
        rugs=(
            ("plain", ("#6c6d6e", "#4a4b4d", "#fff")),
            ("arcs", ("#b5b0a7", "#4e5355", "#a8763f", "#2f4f4d")),
            ("bands", ("#8d8a85", "#55585b", "#c9c4ba", "#6e5a49")),
        ),
        art=("#3b4a52", "#b07a3e", "#8a9194", "#d4c9b4", "#5d3a33"),
        doors=("wood:walnut", "#d9d7d2", "#55585a"),
        frames=("#45474a", "#dcdad6"),
        skirting=("#dad8d4", "#55585a"),
        accent_paint=("#3f4447", "#b5823f", "#d6d3cd"),
    ),
    "mediterranean": Style(
        walls=("#ece3d0", "#ead9bd", "#ebe6da"),
        accents=("#cf8f63", "#5f8fa3", "#d6b072", "#8fa57f"),
        papers=(),
        wall_finish=("lime",),
        floors=(("terracotta", "#b7744f"), ("terracotta", "#c08a62"), ("strips", "pine")),
        wet_floors=(
            ("cement", ("#e6dfcd", "#3f6f8f", "#c58a4c")),
            ("cement", ("#e3dcc8", "#5f8a76", "#b8613f")),
            ("terracotta", ("#b9774f", "#b7a387")),
        ),
        wall_tiles=(
            ("mosaic", "#6fa9b5", "#dcdcd4"),
            ("square", "#7fb0b8", "#dedbd0"),
            ("square_small", "#e3dcc9", "#bfae92"),
        ),
        wood=("pine", "oak"),
        wood_alt=("oak", "walnut"),
        fronts=("#8fb0b3", "#e3dcc8", "wood:pine", "#7f9a7c"),
        fronts_upper=("#e7e0cd",),
        worktops=("wood:oak", "terrazzo:#dcd2bd", "marble:#e2dac8"),
        metal=("#6b5238", "#b08d4f"),
        tap=("#b99a5c", "#c9cbcc"),
        upholstery=(("weave", "#d9ccb0"), ("weave", "#5f8494"), ("weave", "#c58a5f"), ("boucle", "#dfd5bf")),
        cushions=("#c9663c", "#3f7f96", "#e0b45a", "#e6dfcf", "#7f9a6a"),
        textiles=("#e3d8bf", "#9fbfc2", "#dcb98a"),
        bedding=("#e6e0d0", "#8fb3bc", "#d9b183"),
        towels=("#e5dfcf", "#4f94a5", "#e0a65f", "#c9724c"),
        rugs=(
            ("bands", ("#e0d2b0", "#c4683e", "#3f7c90", "#dfae55")),
            ("berber", ("#e5dac2", "#a5563a", "#3f6f82")),
            ("bands", ("#dfd6c2", "#8fa57f", "#5f8fa3", "#cfa45a")),
        ),
        art=("#2f7a96", "#d28a45", "#c9573a", "#e0bd68", "#5f8f6a"),
        doors=("wood:pine", "#7fa3a8", "#e5dcc6"),
        frames=("#5f8d99", "#e7dfcd", "wood:pine"),
        skirting=("#e5dac3", "wood:pine"),
        accent_paint=("#5f98a5", "#d89a52", "#e6dec9"),
    ),
    "industrial": Style(
        walls=("#d4d0c9", "#cbc7c1", "#dcd8cf"),
        accents=("#7d4f3d", "#5d625f", "#8b8781", "#3f5358"),
        papers=(),
        wall_finish=("brick", "brick", "paint"),
        floors=(("concrete", "#a19f9b"), ("strips_wide", "oak_smoked"), ("strips", "ash_grey")),
        wet_floors=(
            ("concrete_tile", ("#a3a19d", "#817f7b")),
            ("hex", ("#55585a", "#6d7071", "#8b8d8c")),
            ("checker", ("#d3d0c9", "#4d4d4e")),
        ),
        wall_tiles=(("metro", "#e0dfda", "#5c5b59"), ("metro", "#3f4d4f", "#8a8885"), ("square", "#d6d4ce", "#6d6b68")),
        wood=("oak", "ash_grey", "oak_smoked"),
        wood_alt=("pine", "oak_smoked"),
        fronts=("#575b5c", "wood:oak", "#3f5257", "#d0cdc6"),
        fronts_upper=("#d3d0c9", "wood:oak"),
        worktops=("wood:oak_smoked", "steel:#b7b9ba", "granite:#4a4a4b"),
        metal=("#363637", "#47423c"),
        tap=("#b89a68", "#4a4a4b"),
        upholstery=(("leather", "#80512f"), ("weave", "#6b6d6b"), ("leather", "#4b3a2e"), ("weave", "#56666b")),
        cushions=("#b8763a", "#5f6d6e", "#d0c8b9", "#8b3f2c", "#3f4f55"),
        textiles=("#9a968e", "#c7c0b3", "#5f625f"),
        bedding=("#c9c4bb", "#6f7a7d", "#a78a68"),
        towels=("#8d9090", "#d9d4ca", "#a96c3f", "#4a5d63"),
        rugs=(
            ("worn", ("#bdb2a0", "#7a4438", "#46555c")),
            ("worn", ("#b5ada0", "#3f5360", "#8a6a4c")),
            ("plain", ("#8b8780", "#5d5a55", "#fff")),
        ),
        art=("#b06a35", "#46565c", "#8b3a2b", "#cbb88f", "#2f3a3d"),
        doors=("#5b5f60", "wood:oak", "#d5d2cb"),
        frames=("#3b3d3e",),
        skirting=("#5d6061", "#d3cfc8"),
        accent_paint=("#3f5358", "#a9632f", "#c9c5bd"),
    ),
}
