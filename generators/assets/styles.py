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
        joinery: keys of `generators.apartments.joinery.JOINERY`: skirting, cornices and windows.
        shaker: probability that cabinet fronts are framed.
        edge: multiple of the usual radius of furniture's edges: below 1 sharp, above 1 rounded and worn.
        legs: of furniture: ``tapered``, ``square`` or ``turned``.
        curtains: ``pleated``, ``eyelet``, ``gathered`` or ``sheer`` (light cloth drawn half across).
        pile: height of the rugs (m).
        lamps: tint of lamps: ``warm``, ``neutral`` or ``cool``.
        wear: 0 (new) to 1 (old): dirt at the skirting, stained and uneven floors and walls.
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
    joinery: tuple[str, ...]
    shaker: float
    edge: float
    legs: tuple[str, ...]
    curtains: tuple[str, ...]
    pile: float
    lamps: tuple[str, ...]
    wear: float


STYLES: dict[str, Style] = {
    # New, middle budget, cold climate.
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
        joinery=("modern", "flat"),
        shaker=0.4,
        edge=1.0,
        legs=("tapered",),
        curtains=("eyelet", "sheer"),
        pile=0.014,
        lamps=("warm", "neutral"),
        wear=0.25,
    ),
    # Between the wars, middle budget, mild climate.
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
        joinery=("classic", "grand"),
        shaker=0.9,
        edge=1.3,
        legs=("turned", "tapered"),
        curtains=("pleated", "gathered"),
        pile=0.012,
        lamps=("warm",),
        wear=0.5,
    ),
    # New, high budget, any climate.
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
        joinery=("flat", "modern"),
        shaker=0.0,
        edge=0.5,
        legs=("square", "tapered"),
        curtains=("eyelet", "pleated"),
        pile=0.016,
        lamps=("neutral", "warm"),
        wear=0.1,
    ),
    # Old, middle budget, hot and dry climate.
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
        joinery=("classic", "low"),
        shaker=0.7,
        edge=1.8,
        legs=("turned", "square"),
        curtains=("gathered", "sheer"),
        pile=0.008,
        lamps=("warm",),
        wear=0.6,
    ),
    # A converted workshop, middle budget, cold climate.
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
        joinery=("modern", "low"),
        shaker=0.3,
        edge=0.8,
        legs=("square",),
        curtains=("eyelet",),
        pile=0.008,
        lamps=("warm", "neutral"),
        wear=0.7,
    ),
    # Two hundred years old, middle budget, cool and wet climate.
    "cottage": Style(
        walls=("#e8e2d2", "#e2ddd0", "#dfe0d4"),
        accents=("#9aa68c", "#8c9fa5", "#c9b08c", "#b5836c"),
        papers=(("sprigs", "#e6e0d0", "#8f9c7c"), ("stripes", "#e5e0d2", "#b9bfae"), ("sprigs", "#dfe0d6", "#a3737a")),
        wall_finish=("paint", "lime"),
        floors=(("strips_wide", "pine"), ("strips_wide", "oak"), ("terracotta", "#a8674a")),
        wet_floors=(
            ("slate", ("#7c7d78", "#5d5e5a")),
            ("terracotta", ("#a96a4b", "#b5a58c")),
            ("checker", ("#ded8c9", "#5a5f5a")),
        ),
        wall_tiles=(
            ("square", "#e3dfd1", "#b5ae9d"),
            ("metro", "#dfddd0", "#a39d8f"),
            ("square_small", "#c9d0c3", "#dedacd"),
        ),
        wood=("pine", "oak"),
        wood_alt=("oak", "cherry"),
        fronts=("#b3bba6", "#dcd6c4", "#8fa0a3", "wood:pine"),
        fronts_upper=("#dcd6c4", "#b3bba6"),
        worktops=("wood:oak", "wood:pine", "granite:#5b5a57"),
        metal=("#4a4440", "#a8854a"),
        tap=("#c2c4c4", "#b08f55"),
        upholstery=(("weave", "#a8a38c"), ("weave", "#8a7464"), ("velvet", "#6f7a5c"), ("weave", "#b5a596")),
        cushions=("#8c9c77", "#b5666a", "#d3b98a", "#6f8794", "#e0d8c6"),
        textiles=("#d6cbb3", "#b9bfa8", "#c9a9a0"),
        bedding=("#e2dccb", "#c2b0b3", "#aab5a5"),
        towels=("#e0dacb", "#9fae98", "#c08f8a", "#8597a0"),
        rugs=(
            ("worn", ("#cbbfa5", "#8a4a42", "#4f6066")),
            ("bands", ("#d9cfb8", "#7f8f6d", "#a5565a", "#c9a866")),
            ("oriental", ("#cdbf9f", "#6f3a33", "#3f4f45")),
        ),
        art=("#5c7360", "#a5696a", "#c9a866", "#5b7280", "#8a6f52"),
        doors=("wood:pine", "#dbd5c4"),
        frames=("#e3dfd2", "#7d8c86"),
        skirting=("#dfdacb", "wood:pine"),
        accent_paint=("#9fae98", "#c2a46a", "#7f939a"),
        joinery=("classic", "low"),
        shaker=0.9,
        edge=2.0,
        legs=("turned",),
        curtains=("gathered", "pleated"),
        pile=0.012,
        lamps=("warm",),
        wear=0.8,
    ),
    # A rented flat of the nineties, low budget, any climate: cheap boards, bright textiles, nothing matches.
    "rented": Style(
        walls=("#e6e5e1", "#e4e2dc", "#dedcd3"),
        accents=("#d9b45f", "#7fa0ae", "#a3b586", "#c98a74"),
        papers=(),
        wall_finish=("paint",),
        floors=(("strips", "birch"), ("strips", "ash_grey"), ("strips_narrow", "oak")),
        wet_floors=(
            ("square", ("#c9c5ba", "#9a958a")),
            ("concrete_tile", ("#b5b2aa", "#8d8a83")),
            ("square", ("#a9b0b2", "#84898a")),
        ),
        wall_tiles=(
            ("square", "#e2e1dc", "#a8a59c"),
            ("square", "#dcd8cc", "#a59f90"),
            ("square_small", "#c3d0d3", "#dcdcd6"),
        ),
        wood=("birch", "pine"),
        wood_alt=("ash_grey", "oak", "wenge"),
        fronts=("#e2e0da", "wood:birch", "#c9c3b3"),
        fronts_upper=("#e2e0da",),
        worktops=("granite:#6d6a66", "wood:birch", "terrazzo:#b9b5ac"),
        metal=("#8d9092", "#3f3f40"),
        tap=("#c9cbcc",),
        upholstery=(("weave", "#5f6f80"), ("weave", "#8d8478"), ("weave", "#a5493f"), ("weave", "#3f4347")),
        cushions=("#d9623f", "#3f8f9f", "#e0b83f", "#7f4f7a", "#7fa04f"),
        textiles=("#c9c3b5", "#6f8fa5", "#b55f4f"),
        bedding=("#8fa8bd", "#d9d3c6", "#b0605c"),
        towels=("#d9623f", "#4f8fa8", "#e0c15f", "#8f6fa0"),
        rugs=(
            ("plain", ("#8f8f8a", "#5d6064", "#fff")),
            ("arcs", ("#d9d0bd", "#d9623f", "#3f8f9f", "#e0b83f")),
            ("bands", ("#c9c5bd", "#4f6f8f", "#b5493f", "#3f4347")),
        ),
        art=("#d9623f", "#3f6f8f", "#e0b83f", "#3f3f47", "#7fa07f"),
        doors=("#e0ded8", "wood:birch"),
        frames=("#e6e5e2",),
        skirting=("#dedcd6", "wood:birch"),
        accent_paint=("#c9533f", "#3f7f8f", "#e0ddd5"),
        joinery=("low", "flat"),
        shaker=0.0,
        edge=0.7,
        legs=("square", "tapered"),
        curtains=("eyelet", "sheer"),
        pile=0.01,
        lamps=("cool", "neutral"),
        wear=0.9,
    ),
    # The sixties, middle budget, mild climate.
    "mid_century": Style(
        walls=("#e6dfce", "#e2dccd", "#dcd9cc"),
        accents=("#5f7f7a", "#c98f3f", "#a5583a", "#8a8f5c"),
        papers=(("trellis", "#e0d8c2", "#b58f52"), ("stripes", "#dcd6c2", "#9a9f80")),
        wall_finish=("paint",),
        floors=(("herringbone_straight", "oak"), ("strips_narrow", "cherry"), ("strips", "oak")),
        wet_floors=(
            ("terrazzo", ("#d3cdbf", "#7d766c", "#b5855f", "#5f6f6a")),
            ("square", ("#b9b79f", "#8f8d78")),
            ("checker", ("#ddd8c6", "#6f8580")),
        ),
        wall_tiles=(
            ("square", "#c3cdb9", "#e0ddd0"),
            ("mosaic", "#8fb0a8", "#dcdad0"),
            ("square_small", "#e0cf9f", "#c2b48f"),
        ),
        wood=("cherry", "walnut"),
        wood_alt=("walnut", "cherry"),
        fronts=("wood:cherry", "#c9c6b0", "#8fa59c", "wood:walnut"),
        fronts_upper=("#dedac8", "wood:cherry"),
        worktops=("terrazzo:#d0cabb", "granite:#8d8578", "wood:cherry"),
        metal=("#a8854a", "#3f3f3f"),
        tap=("#c9cbcc",),
        upholstery=(("weave", "#b5873f"), ("weave", "#5f7f7a"), ("boucle", "#cfc6b0"), ("leather", "#7a4a2c")),
        cushions=("#d99a3a", "#4f7f7f", "#b5563a", "#8f9455", "#e0d6bd"),
        textiles=("#cfae6a", "#8fa08a", "#c98f6a"),
        bedding=("#dcd3bd", "#c9a05f", "#7f9a98"),
        towels=("#d9a24a", "#6f9a98", "#c0694a", "#dcd6c4"),
        rugs=(
            ("arcs", ("#d9cfb5", "#c9853a", "#4f7f7a", "#7a4a34")),
            ("berber", ("#ddd2b8", "#8a5a3a", "#5f7f7a")),
            ("plain", ("#b5873f", "#7a5a34", "#fff")),
        ),
        art=("#4f7f7f", "#d9953a", "#b0543a", "#e0cf9f", "#3f4a45"),
        doors=("wood:cherry", "#dedac8"),
        frames=("wood:cherry", "#e2dfd4"),
        skirting=("wood:cherry", "#e0dccf"),
        accent_paint=("#c9853a", "#4f7f7a", "#dcd6c4"),
        joinery=("low", "modern"),
        shaker=0.0,
        edge=1.6,
        legs=("tapered",),
        curtains=("pleated",),
        pile=0.018,
        lamps=("warm",),
        wear=0.6,
    ),
    # New, middle budget, hot and humid climate: hard floors, rattan, light cloth.
    "tropical": Style(
        walls=("#eceae2", "#e9e6da", "#e2e8e2"),
        accents=("#5f8f7f", "#d9a58a", "#7fb0b0", "#cfc08a"),
        papers=(("sprigs", "#e6e8dd", "#7f9f80"),),
        wall_finish=("paint", "lime"),
        floors=(("ceramic", "#d9d3c5"), ("ceramic", "#c9c6bd"), ("strips", "cherry")),
        wet_floors=(
            ("cement", ("#e3e0d5", "#5f8f8a", "#d0a58a")),
            ("square", ("#d3cfc4", "#a9a598")),
            ("hex", ("#dcd9cf", "#b9c9c0", "#8fb0a5")),
        ),
        wall_tiles=(
            ("mosaic", "#8fc0b8", "#e0e0d8"),
            ("metro_v", "#b5cfc3", "#e0ded5"),
            ("square", "#e5e3da", "#bab6aa"),
        ),
        wood=("cherry", "oak"),
        wood_alt=("oak", "oak_pale"),
        fronts=("#dfe3da", "#9fbfb0", "wood:oak", "#e6ddc9"),
        fronts_upper=("#e6e6de",),
        worktops=("terrazzo:#dcd8cc", "marble:#e2e0d8", "wood:cherry"),
        metal=("#a08348", "#4a4a48"),
        tap=("#c9cbcc", "#b59a63"),
        upholstery=(("weave", "#dcd3bf"), ("weave", "#6f9a8a"), ("weave", "#c9b08a"), ("weave", "#d98f78")),
        cushions=("#4f9a85", "#e08f70", "#e0c56a", "#3f7f95", "#e6e0d0"),
        textiles=("#e6e1d3", "#bcd0c2", "#e0c3ae"),
        bedding=("#e8e4d9", "#a9cbc0", "#e0b5a0"),
        towels=("#e6e2d6", "#5fa898", "#e09a7f", "#e0cb7f"),
        rugs=(
            ("bands", ("#dccfae", "#b59a66", "#8f7a4f", "#e2d8be")),
            ("plain", ("#cdbb92", "#8f7a52", "#fff")),
            ("berber", ("#e0d6bf", "#4f8a78", "#c98f5f")),
        ),
        art=("#3f8f7f", "#e09a5f", "#d9624f", "#e0cb6a", "#2f6f7f"),
        doors=("#e3e3da", "wood:cherry"),
        frames=("#e8e7e0", "wood:cherry"),
        skirting=("#e2e0d6",),
        accent_paint=("#4f9a8a", "#e0a05f", "#e6e2d6"),
        joinery=("flat", "low"),
        shaker=0.4,
        edge=1.2,
        legs=("tapered", "square"),
        curtains=("sheer", "eyelet"),
        pile=0.007,
        lamps=("neutral", "warm"),
        wear=0.35,
    ),
    # About 1900, high budget, mild climate: high skirting, mouldings, parquet, velvet and brass.
    "period": Style(
        walls=("#e4e2dc", "#dfdcd3", "#d6d8d4"),
        accents=("#2f4a4f", "#3f4f3f", "#6f3f45", "#a5a08f"),
        papers=(("damask", "#c9ccc0", "#a9ad9c"), ("damask", "#5a6a68", "#76857f"), ("stripes", "#dedacd", "#b9b39f")),
        wall_finish=("paint",),
        floors=(("herringbone", "oak"), ("herringbone", "oak_pale"), ("herringbone_straight", "walnut")),
        wet_floors=(
            ("checker", ("#e0ddd3", "#3f4242")),
            ("marble", ("#dedcd5", "#8a8d8f")),
            ("cement", ("#ddd8c9", "#3f4f55", "#a57a52")),
        ),
        wall_tiles=(
            ("marble", "#e0deda", "#8a8d90"),
            ("metro", "#e3e1da", "#8f8d86"),
            ("metro_v", "#4f6a62", "#8a8f88"),
        ),
        wood=("walnut", "mahogany"),
        wood_alt=("oak", "walnut"),
        fronts=("#3f5055", "#d9d6cc", "#55604f", "wood:walnut"),
        fronts_upper=("#d9d6cc", "#3f5055"),
        worktops=("marble:#e2e0da", "granite:#3f3f41", "marble:#d0cdc4"),
        metal=("#b0904f", "#9a7a3f"),
        tap=("#b8985a", "#c9cbcc"),
        upholstery=(("velvet", "#2f4f55"), ("velvet", "#6a3a44"), ("boucle", "#d6d0c2"), ("leather", "#5a3826")),
        cushions=("#b0904f", "#7a3f48", "#3f5f5a", "#d6cfbd", "#8f8f9a"),
        textiles=("#5f7072", "#b5a78a", "#7a4a4f"),
        bedding=("#e0ddd3", "#8f9a9a", "#a5787a"),
        towels=("#e0ddd3", "#5f7a7a", "#a0686a", "#b59a63"),
        rugs=(
            ("oriental", ("#cfc0a0", "#6f2a2c", "#2a3a4a")),
            ("worn", ("#c5b89c", "#7a4a44", "#3f4f5a")),
            ("oriental", ("#b9ad94", "#2f4a4f", "#8a5a3a")),
        ),
        art=("#3f5a5f", "#8a5a3a", "#a5303a", "#cbb88a", "#2a3238"),
        doors=("#dedbd2", "wood:walnut"),
        frames=("#e2e0d8",),
        skirting=("#dedbd3",),
        accent_paint=("#2f4a4f", "#a08345", "#dad6ca"),
        joinery=("grand",),
        shaker=1.0,
        edge=1.0,
        legs=("turned", "tapered"),
        curtains=("pleated",),
        pile=0.012,
        lamps=("warm",),
        wear=0.3,
    ),
}
