"""The catalogue's lines for living rooms, with what bedrooms and halls share with them."""

from __future__ import annotations

from generators.assets.clutter import containers, devices, hanging, ornaments, reading, soft, toys
from generators.assets.clutter.record import ClutterKind

KINDS = (
    ClutterKind(
        "wicker_basket",
        containers.basket,
        ("floor",),
        {"living_room": (1, 2), "bedroom": (0, 1), "hall": (1, 1)},
        turn=40,
    ),
    ClutterKind("floor_cushion", soft.floor_cushion, ("floor",), {"living_room": (0, 1), "bedroom": (0, 1)}, turn=180),
    ClutterKind("magazine_rack", containers.magazine_rack, ("floor",), {"living_room": (0, 1)}, turn=25),
    ClutterKind("toy_bin", containers.ring_basket, ("floor",), {"living_room": (0, 1), "bedroom": (0, 1)}, turn=12),
    ClutterKind(
        "slat_crate", containers.crate, ("floor",), {"living_room": (0, 1), "bedroom": (0, 1)}, turn=8, rear=True
    ),
    ClutterKind(
        "power_strip",
        devices.power_strip,
        ("floor",),
        {"living_room": (1, 2), "bedroom": (1, 1), "hall": (0, 1)},
        turn=8,
        rear=True,
    ),
    ClutterKind("building_blocks", toys.blocks, ("floor",), {"living_room": (0, 1), "bedroom": (0, 1)}, turn=180),
    ClutterKind(
        "play_ball", toys.ball, ("floor",), {"living_room": (0, 1), "bedroom": (0, 1), "hall": (0, 1)}, turn=180
    ),
    ClutterKind(
        "picture_ledge",
        hanging.picture_ledge,
        ("wall",),
        {"living_room": (1, 1), "bedroom": (0, 1), "hall": (0, 1)},
        height=(1.25, 1.7),
    ),
    ClutterKind(
        "wall_cube",
        hanging.cube_shelf,
        ("wall",),
        {"living_room": (1, 2), "bedroom": (1, 2), "hall": (1, 2)},
        height=(1.3, 1.75),
    ),
    ClutterKind(
        "woven_hanging",
        hanging.woven_hanging,
        ("wall",),
        {"living_room": (0, 1), "bedroom": (0, 1), "hall": (0, 1)},
        height=(1.45, 1.7),
    ),
    ClutterKind(
        "framed_mirror",
        hanging.framed_mirror,
        ("wall",),
        {"living_room": (0, 1), "bedroom": (0, 1), "hall": (1, 1)},
        height=(1.45, 1.65),
    ),
    ClutterKind("loudspeaker", devices.loudspeaker, ("sideboard", "board"), {"living_room": (1, 2)}, turn=8, rear=True),
    ClutterKind(
        "drinks_tray", ornaments.tray_with_cups, ("sideboard", "coffee_table"), {"living_room": (0, 1)}, turn=6
    ),
    ClutterKind("games_console", devices.games_console, ("sideboard", "board"), {"living_room": (0, 1)}, turn=5),
    ClutterKind(
        "stems_in_vase",
        ornaments.vase_with_stems,
        ("sideboard", "coffee_table", "sill", "board"),
        {"living_room": (1, 2), "bedroom": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "flower_vase",
        ornaments.flowers,
        ("coffee_table", "sideboard", "sill", "table"),
        {"living_room": (1, 1), "bedroom": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "table_globe",
        ornaments.globe,
        ("sideboard", "board", "desk"),
        {"living_room": (0, 1), "bedroom": (0, 1)},
        turn=60,
    ),
    ClutterKind("board_games", toys.board_games, ("board", "sideboard"), {"living_room": (0, 1)}, turn=5),
    ClutterKind(
        "photograph",
        ornaments.photo_frame,
        ("sideboard", "board", "sill", "nightstand", "desk"),
        {"living_room": (3, 5), "bedroom": (2, 3), "hall": (2, 3)},
        turn=20,
        rear=True,
    ),
    ClutterKind(
        "books_standing",
        reading.standing_books,
        ("sideboard", "board", "sill", "desk", "cabinet_top"),
        {"living_room": (3, 5), "bedroom": (2, 3), "hall": (0, 1)},
        turn=5,
        rear=True,
    ),
    ClutterKind(
        "books_lying",
        reading.lying_books,
        ("coffee_table", "sideboard", "board", "seat", "sill"),
        {"living_room": (3, 5), "bedroom": (1, 2), "hall": (0, 1)},
        turn=25,
    ),
    ClutterKind(
        "book_open", reading.open_book, ("coffee_table", "sideboard", "seat", "table"), {"living_room": (1, 1)}, turn=35
    ),
    ClutterKind(
        "magazines",
        reading.magazines,
        ("coffee_table", "sideboard", "seat", "floor"),
        {"living_room": (1, 2), "bedroom": (0, 1), "hall": (0, 1)},
        turn=35,
    ),
    ClutterKind(
        "newspaper", reading.newspaper, ("coffee_table", "seat", "table", "sideboard"), {"living_room": (1, 1)}, turn=35
    ),
    ClutterKind(
        "remote_control",
        devices.remote_control,
        ("coffee_table", "sideboard", "seat"),
        {"living_room": (2, 3)},
        turn=70,
    ),
    ClutterKind(
        "game_controller",
        devices.game_controller,
        ("coffee_table", "sideboard", "seat"),
        {"living_room": (1, 2)},
        turn=70,
    ),
    ClutterKind(
        "tablet_computer",
        devices.tablet,
        ("coffee_table", "sideboard", "nightstand"),
        {"living_room": (1, 1), "bedroom": (0, 1)},
        turn=30,
    ),
    ClutterKind(
        "headphones",
        devices.headphones,
        ("coffee_table", "sideboard", "desk"),
        {"living_room": (0, 1), "bedroom": (1, 1)},
        turn=60,
    ),
    ClutterKind(
        "reading_glasses",
        ornaments.spectacles,
        ("coffee_table", "nightstand", "sideboard", "desk"),
        {"living_room": (1, 1), "bedroom": (0, 1), "hall": (0, 1)},
        turn=80,
    ),
    ClutterKind(
        "candle_group",
        ornaments.candles,
        ("coffee_table", "sideboard", "sill", "board"),
        {"living_room": (1, 2), "bedroom": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "candlestick",
        ornaments.candlestick,
        ("sideboard", "table", "board", "sill"),
        {"living_room": (1, 2), "kitchen": (0, 1), "hall": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "tea_light",
        ornaments.tea_light,
        ("coffee_table", "sill", "sideboard", "board"),
        {"living_room": (2, 3), "bedroom": (1, 1), "hall": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "coasters", ornaments.coasters, ("coffee_table", "table"), {"living_room": (1, 1), "kitchen": (0, 1)}, turn=60
    ),
    ClutterKind(
        "tumbler",
        ornaments.drinking_glass,
        ("coffee_table", "nightstand", "desk", "table"),
        {"living_room": (1, 2), "bedroom": (1, 2)},
        turn=180,
    ),
    ClutterKind(
        "tea_mug",
        ornaments.mug,
        ("coffee_table", "desk", "sideboard", "nightstand", "table"),
        {"living_room": (1, 2), "bedroom": (1, 2)},
        turn=180,
    ),
    ClutterKind(
        "shallow_dish",
        ornaments.dish,
        ("sideboard", "coffee_table", "board", "sill"),
        {"living_room": (1, 2), "bedroom": (0, 1), "hall": (1, 1)},
        turn=180,
    ),
    ClutterKind(
        "plain_vase",
        ornaments.empty_vase,
        ("board", "sideboard", "sill", "cabinet_top"),
        {"living_room": (2, 3), "bedroom": (1, 2), "hall": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "sculpture",
        ornaments.sculpture,
        ("sideboard", "board", "sill"),
        {"living_room": (1, 3), "bedroom": (0, 1), "hall": (0, 1)},
        turn=40,
    ),
    ClutterKind(
        "sill_plant",
        ornaments.pot_plant,
        ("sill", "sideboard", "board", "cabinet_top"),
        {"living_room": (2, 3), "bedroom": (1, 2)},
        turn=180,
    ),
    ClutterKind(
        "succulents",
        ornaments.succulents,
        ("sill", "board", "sideboard"),
        {"living_room": (1, 2), "bedroom": (1, 1), "kitchen": (0, 1), "hall": (0, 1)},
        turn=20,
    ),
    ClutterKind(
        "lidded_box",
        containers.storage_box,
        ("board", "cabinet_top", "floor"),
        {"living_room": (1, 2), "bedroom": (2, 4), "hall": (1, 2)},
        turn=6,
        rear=True,
    ),
    ClutterKind(
        "toy_car",
        toys.toy_car,
        ("floor", "coffee_table", "sill"),
        {"living_room": (0, 2), "bedroom": (0, 1), "hall": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "wooden_train", toys.wooden_train, ("sill", "floor"), {"living_room": (0, 1), "bedroom": (0, 1)}, turn=60
    ),
    ClutterKind(
        "stacking_rings",
        toys.stacking_rings,
        ("floor", "board", "sill"),
        {"living_room": (0, 1), "bedroom": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "tissues",
        ornaments.tissue_box,
        ("sideboard", "nightstand", "coffee_table", "desk"),
        {"living_room": (0, 1), "bedroom": (1, 1)},
        turn=20,
    ),
    ClutterKind(
        "letters",
        reading.envelopes,
        ("sideboard", "coffee_table", "desk"),
        {"living_room": (1, 1), "bedroom": (0, 1), "hall": (1, 1)},
        turn=60,
    ),
    ClutterKind(
        "charger",
        devices.charging_cable,
        ("sideboard", "nightstand", "floor"),
        {"living_room": (1, 1), "bedroom": (1, 1), "hall": (0, 1)},
        turn=60,
    ),
    ClutterKind(
        "house_slippers", soft.slippers, ("floor",), {"living_room": (0, 1), "bedroom": (1, 1), "hall": (1, 2)}, turn=40
    ),
    ClutterKind(
        "scent_sticks",
        ornaments.scent_sticks,
        ("sideboard", "sill", "board"),
        {"living_room": (0, 1), "bedroom": (0, 1), "bathroom": (0, 1), "hall": (0, 1)},
        turn=90,
    ),
    ClutterKind("paper_roll_vase", containers.paper_roll_vase, ("floor",), {"living_room": (0, 1)}, turn=180),
    ClutterKind(
        "folded_blanket",
        soft.folded_blanket,
        ("seat", "bed", "board", "floor"),
        {"living_room": (1, 1), "bedroom": (1, 2)},
        turn=15,
    ),
    ClutterKind(
        "loose_cushion", soft.cushion, ("seat", "bed", "floor"), {"living_room": (1, 2), "bedroom": (1, 2)}, turn=60
    ),
    ClutterKind(
        "spread_throw", soft.throw_blanket, ("seat", "bed"), {"living_room": (1, 1), "bedroom": (1, 1)}, turn=25
    ),
)
