"""Shows a run: a bar with the rate and the time left, and one line per finished observation."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from generators.plan import ObservationPlan

#: Between two lines on how far the run is, where no bar is drawn, seconds.
_SUMMARY = 60.0


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("– frames/s" if speed is None else f"{speed:.1f} frames/s", style="progress.data.speed")


@contextmanager
def reporting(plans: tuple[ObservationPlan, ...]) -> Iterator[Callable[[tuple[str, str, str]], None]]:
    """A listener for `generators.run.runner.run` that draws on stderr; lines only where stderr is not a terminal."""
    console = Console(file=sys.stderr, highlight=False)
    frames = {plan.key: plan.camera.frames for plan in plans}
    lock = threading.Lock()
    drawn: dict[str, int] = {}
    began = said = time.monotonic()
    ended = made = 0
    to_make = sum(frames.values())
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("generating", total=to_make)

        def say(line: str) -> None:
            (bar.console if console.is_terminal else console).print(line, soft_wrap=True, markup=False)

        def summarise() -> None:
            """Where no bar is drawn, say every now and then how far the run is."""
            nonlocal said
            now = time.monotonic()
            if console.is_terminal or now - said < _SUMMARY:
                return
            said = now
            rate = made / (now - began)
            left = (
                "–" if not rate else str(timedelta(seconds=round((sum(frames.values()) - sum(drawn.values())) / rate)))
            )
            say(f"{ended} of {len(frames)} observations, {rate:.1f} frames/s, {left} left")

        def listen(event: tuple[str, str, str]) -> None:
            nonlocal ended, made, to_make
            kind, key, text = event
            with lock:
                if kind == "home":
                    bar.update(task, description=f"opening {key}")
                    say(f"home {key}: read, or built and lit where it is not in the cache yet")
                elif kind == "start":
                    bar.update(task, description="generating")
                elif kind == "frame":
                    # The newest of several; one that is made a second time draws from the beginning again.
                    newest = max(drawn.get(key, 0), int(text) + 1)
                    bar.advance(task, newest - drawn.get(key, 0))
                    made += newest - drawn.get(key, 0)
                    drawn[key] = newest
                elif kind in ("kept", "done", "failed"):
                    ended += 1
                    rest = frames[key] - drawn.get(key, 0)
                    if kind == "done":
                        made += rest
                        bar.advance(task, rest)
                    else:  # nobody makes these frames now: counted as progress, they would spoil rate and time left
                        to_make -= rest
                        bar.update(task, total=to_make)
                    drawn[key] = frames[key]
                    mark = {"kept": "kept  ", "done": "done  ", "failed": "failed"}[kind]
                    say(f"{mark} {key}" + (f"  {text}" if text else ""))
                elif kind in ("retry", "worker", "note"):
                    say("  ".join(filter(None, (f"{kind:6}", key, text))))
                summarise()

        yield listen
