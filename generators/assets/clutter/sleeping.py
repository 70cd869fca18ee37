"""The catalogue's lines for bedrooms: clothes, shoes, bags, bedside things and the desk."""

from __future__ import annotations

from generators.assets.clutter import containers, devices, hanging, ornaments, reading, soft, toys
from generators.assets.clutter.record import ClutterKind

KINDS = (
    ClutterKind(
        "suitcase",
        containers.suitcase,
        ("cabinet_top", "floor"),
        {"bedroom": (1, 1), "hall": (0, 1)},
        turn=8,
        rear=True,
    ),
    ClutterKind(
        "cardboard_box",
        containers.cardboard_box,
        ("cabinet_top", "floor"),
        {"bedroom": (0, 2), "living_room": (0, 1), "hall": (0, 1)},
        turn=10,
    ),
    ClutterKind(
        "waste_basket",
        containers.waste_basket,
        ("floor",),
        {"bedroom": (1, 1), "living_room": (0, 1), "hall": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "rucksack", soft.rucksack, ("floor",), {"bedroom": (1, 1), "living_room": (0, 1), "hall": (0, 1)}, turn=35
    ),
    ClutterKind("laundry_heap", soft.laundry_pile, ("floor",), {"bedroom": (1, 1)}, turn=180),
    ClutterKind("shoe_pair", soft.shoes, ("floor",), {"bedroom": (1, 2)}, turn=40),
    ClutterKind(
        "handbag",
        soft.tote_bag,
        ("floor", "sideboard", "seat"),
        {"bedroom": (1, 1), "living_room": (0, 1), "hall": (1, 1)},
        turn=30,
    ),
    ClutterKind("hook_rail", hanging.hook_rail, ("wall",), {"bedroom": (0, 1), "hall": (1, 1)}, height=(1.5, 1.6)),
    ClutterKind("dressing_gown", soft.garment_on_hook, ("wall",), {"bedroom": (1, 1)}, height=(1.2, 1.35)),
    ClutterKind("shirt_on_hanger", soft.hanger_with_shirt, ("wall",), {"bedroom": (1, 1)}, height=(1.35, 1.5)),
    ClutterKind("under_bed_box", containers.tray_box, ("floor",), {"bedroom": (0, 1)}, turn=4),
    ClutterKind("monitor", devices.monitor, ("desk",), {"bedroom": (0, 1)}, turn=8, rear=True),
    ClutterKind(
        "laptop_open", devices.laptop_open, ("desk", "table"), {"bedroom": (0, 1), "living_room": (0, 1)}, turn=12
    ),
    ClutterKind("keyboard", devices.keyboard, ("desk",), {"bedroom": (0, 1)}, turn=5),
    ClutterKind(
        "desk_lamp", devices.desk_lamp, ("desk", "nightstand", "sideboard"), {"bedroom": (1, 2)}, turn=25, rear=True
    ),
    ClutterKind(
        "letter_tray",
        ornaments.letter_tray,
        ("desk", "board", "sideboard"),
        {"bedroom": (0, 1), "living_room": (0, 1), "hall": (0, 1)},
        turn=6,
        rear=True,
    ),
    ClutterKind(
        "pens_in_cup",
        ornaments.pen_cup,
        ("desk", "board", "sill"),
        {"bedroom": (1, 1), "living_room": (0, 1), "hall": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "notebook",
        reading.notebook,
        ("desk", "nightstand", "coffee_table"),
        {"bedroom": (1, 2), "living_room": (0, 1), "hall": (0, 1)},
        turn=25,
    ),
    ClutterKind(
        "loose_papers",
        reading.papers,
        ("desk", "table", "coffee_table", "sideboard"),
        {"bedroom": (1, 1), "living_room": (0, 1)},
        turn=20,
    ),
    ClutterKind(
        "laptop_closed",
        devices.laptop_closed,
        ("desk", "coffee_table", "bed"),
        {"bedroom": (0, 1), "living_room": (0, 1)},
        turn=15,
    ),
    ClutterKind("mouse", devices.mouse, ("desk",), {"bedroom": (1, 1)}, turn=20),
    ClutterKind("stapler", ornaments.stapler, ("desk", "board"), {"bedroom": (0, 1)}, turn=50),
    ClutterKind("sticky_tape", ornaments.sticky_tape, ("desk", "sideboard"), {"bedroom": (0, 1)}, turn=60),
    ClutterKind(
        "ring_binders",
        ornaments.binders,
        ("board", "cabinet_top", "desk"),
        {"bedroom": (0, 1), "living_room": (0, 1)},
        turn=3,
        rear=True,
    ),
    ClutterKind(
        "jewellery_box",
        ornaments.jewellery_box,
        ("nightstand", "sill", "sideboard", "desk"),
        {"bedroom": (1, 1)},
        turn=15,
    ),
    ClutterKind("bedside_book", reading.lying_books, ("nightstand",), {"bedroom": (1, 2)}, turn=25),
    ClutterKind("bedside_reading", reading.open_book, ("nightstand", "bed"), {"bedroom": (0, 1)}, turn=25),
    ClutterKind(
        "water_carafe",
        ornaments.carafe,
        ("nightstand", "table", "sideboard"),
        {"bedroom": (0, 1), "living_room": (0, 1)},
        turn=180,
    ),
    ClutterKind(
        "folded_clothes", soft.folded_clothes, ("bed", "seat", "cabinet_top", "board"), {"bedroom": (2, 3)}, turn=15
    ),
    ClutterKind("dropped_jumper", soft.dropped_garment, ("bed", "seat", "floor"), {"bedroom": (0, 1)}, turn=180),
    ClutterKind(
        "plush_bear",
        toys.plush_bear,
        ("bed", "board", "seat", "cabinet_top"),
        {"bedroom": (1, 1), "living_room": (0, 1)},
        turn=30,
    ),
    ClutterKind("paper_ball", reading.paper_ball, ("floor", "desk"), {"bedroom": (0, 1)}, turn=180),
)
