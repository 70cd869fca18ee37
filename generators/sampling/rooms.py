"""Contents of the rooms of a sampled manifest: categories and numbers that procedural rooms have places for."""

from __future__ import annotations

#: Room → category → the largest number of identical objects. Of 1,296 observations drawn with these numbers, 1,293
#: could be placed (docs/leaks.md); in a bathroom, a second vacuum cleaner or toilet often is the last thing that fits.
MOST: dict[str, dict[str, int]] = {
    "bathroom": {"washing_machine": 2, "toilet": 2, "vacuum_cleaner": 2},
    "kitchen": {"microwave": 3, "coffee_machine": 3, "clock": 4, "telephone": 2},
    "living_room": {"telephone": 3, "clock": 4, "vacuum_cleaner": 3},
}
#: Room → the distractor that looks like what sounds there, and the probability that it is there.
LOOK_ALIKES, LOOK_ALIKE_SHARE = {"kitchen": "oven"}, 0.5
#: Room → the other distractors that stand in such rooms, always silent.
DISTRACTORS_IN: dict[str, tuple[str, ...]] = {
    "bathroom": ("fan", "radio"),
    "kitchen": ("dishwasher", "kettle", "fan", "radio"),
    "living_room": ("fan", "radio"),
}
#: Sound of no class → the distractor that could make it; nothing in a room could be a dog or the street.
MADE_BY = {"dishwasher": "dishwasher", "fan": "fan", "kettle": "kettle", "music": "radio", "speech_babble": "radio"}
#: Largest number of other objects beside several identical ones, and beside a single one; a distractor may be one more.
MOST_BESIDE = {"bathroom": (1, 2), "kitchen": (2, 3), "living_room": (2, 2)}
