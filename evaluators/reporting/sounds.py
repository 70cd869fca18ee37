"""Sources in a frame of part_3, for reports: in words, and the instances that are taken for them most easily."""

from __future__ import annotations

from collections import Counter

from avs3d_bench.dataset import Frame


def sounds_in(frame: Frame) -> str:
    """Audible sources of a frame in words: ``microwave and telephone``, ``clock in the living room``, ``silence``."""
    record, entry = frame.observation.record, frame.record
    if record is None or entry is None or entry.audible is None:
        return "not known"
    found: Counter[str] = Counter()
    for one in entry.audible:
        source = record.source(one.source)
        name = source.category.replace("_", " ")
        found[name if source.instance is not None else f"{name} in the {source.room.replace('_', ' ')}"] += 1
    words = [name if count == 1 else f"{count} × {name}" for name, count in found.items()]
    if record.background is not None:
        words.append(f"background ({record.background.kind.replace('_', ' ')})")
    if not words:
        return "silence"
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else last


def silent_twins(frame: Frame) -> tuple[int, ...]:
    """Ids of the instances of the categories that sound, without those that sound themselves.

    In part_3 what is audible in the frame counts, sources in other rooms included; in the other parts the category of
    the observation. Nothing where the data do not say what sounds.
    """
    record, entry = frame.observation.record, frame.record
    if record is None:
        return ()
    if not record.is_sound_scene:
        return tuple(one.id for one in record.instances if one.category == record.category and not one.sounding)
    if entry is None or entry.audible is None:
        return ()
    categories = {record.source(one.source).category for one in entry.audible}
    heard = record.audible_instances(entry)
    return tuple(one.id for one in record.instances if one.category in categories and one.id not in heard)
